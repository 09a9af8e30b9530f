"""The node group of one aged material: the artist's values in, those of their local age out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import bpy

from ....model_runtime.contract import COEFFICIENTS_A_FILE
from ....model_runtime.live.evaluate import ROUGHNESS_MIN, Curves
from ...known import image_texture
from ..result import LiveFiles
from .arrange import arrange
from .formula import Canvas, Number, Triple, greater, where, where3
from .mapping import exact_group, forward_group, new_group, read_back_group
from .stops import Array, stops_of

__all__ = ("AUTHORED", "OUTPUTS", "aged_group")

AUTHORED = ("Base Color", "Metallic", "Roughness", "Specular IOR Level", "IOR", "Specular Tint")
"""The group's inputs that take what feeds the Principled BSDF."""

OUTPUTS = {
    "principled": ("Base Color", "Metallic", "Roughness", "Specular IOR Level"),
    "principled-exact": ("Base Color", "Specular Tint", "Roughness"),
    "torrance-sparrow": ("Diffuse", "Specular", "Roughness"),
}
"""What the group gives, by the format of the result."""

_UNTIL = "As authored until something ages"

_HALF_ZERO = 2.0**-15
"""What Cycles makes of 0 in an image of half floats."""

_Texture = Callable[[Path, str], Triple]


class _State(NamedTuple):
    """Torrance-Sparrow parameters, or what is done with them."""

    kd: Triple
    ks: Triple
    roughness: Number


def aged_group(
    name: str,
    maps: LiveFiles,
    curves: Curves,
    *,
    age: str,
    vector: bool,
    load: Callable[[bpy.types.ShaderNodeTexImage, Path], None],
) -> bpy.types.NodeTree:
    """A group called `name` that ages by `maps` and their `curves`.

    `age` is the custom property by which an object may have an age of its own. With `vector` an
    input says where the textures are looked up, else the UV map does. `load` lets a texture show a
    file.
    """
    inputs = (*AUTHORED, "Age", *(("Vector",) if vector else ()))
    group = new_group(name, inputs, OUTPUTS[maps.format])
    _add_dead_end(group)
    canvas = Canvas(group)

    def texture(path: Path, label: str) -> Triple:
        at = (canvas.triple("Vector"),) if vector else ()
        node = canvas.add("ShaderNodeTexImage", *at, label=label)
        load(image_texture(node), path)
        return Triple(canvas, node.outputs["Color"])

    local = _local_age(canvas, age, maps.timing, texture)
    start = _forward(canvas)
    state = _changed(canvas, start, local, curves, maps.coefficients, texture)
    result = _GIVE[maps.format](canvas, start, _limited(canvas, state), local)
    with canvas.stage("Result"):
        canvas.give(dict(zip(OUTPUTS[maps.format], result, strict=True)))
    arrange(group)
    return group


def _add_dead_end(group: bpy.types.NodeTree) -> None:
    """A first Group Output, which is not the active one: the glTF exporter looks no further.

    It would follow every path through the nodes behind the other, of which there are millions.
    """
    end = group.nodes.new("NodeGroupOutput")
    end.label, end.hide, end.location = "glTF looks no further", True, (0, 200)


def _local_age(canvas: Canvas, age: str, timing: Path | None, texture: _Texture) -> Number:
    """a = clamp(a0 + rate max(0, t - onset), 0, 1); t is the object's own age if it has one."""
    with canvas.stage("Age, or the object's own"):
        own = canvas.add(
            "ShaderNodeAttribute", attribute_type="INSTANCER", attribute_name=age, label="Object"
        )
        has_own = Number(canvas, own.outputs["Alpha"])
        t = where(has_own, Number(canvas, own.outputs["Fac"]), canvas.number("Age"))
    with canvas.stage("Local age: start + rate · (age - onset)"):
        if timing is None:
            return t.clamp()
        onset, rate, start = texture(timing, "Onset, rate, start").channels()
        start = (start - _HALF_ZERO).maximum(0.0)
        return (t - onset).maximum(0.0).scaled(rate, start).clamp()


def _forward(canvas: Canvas) -> _State:
    with canvas.stage("As authored"):
        names = ("Base Color", "Metallic", "Specular IOR Level", "IOR", "Specular Tint")
        authored = tuple(canvas.number(each) for each in names)
        node = canvas.add("ShaderNodeGroup", *authored, node_tree=forward_group())
        kd, ks = (Triple(canvas, each) for each in node.outputs)
        return _State(kd, ks, canvas.number("Roughness").clamp())


def _changed(
    canvas: Canvas,
    state: _State,
    local: Number,
    curves: Curves,
    coefficients: tuple[Path, ...],
    texture: _Texture,
) -> _State:
    """y(a) = G(a) y0 + O(a) + sum_k c_k V_k(a)."""
    with canvas.stage("Gain"):
        gain = _curves(canvas, local, curves.gain)
    with canvas.stage("Offset"):
        offset = _curves(canvas, local, curves.offset)
    changes = []
    for number, shape in enumerate(curves.shapes):
        channel = number % COEFFICIENTS_A_FILE
        if channel == 0:
            with canvas.stage("Coefficients"):
                path = coefficients[number // COEFFICIENTS_A_FILE]
                shares = texture(path, "Coefficients").channels()
        with canvas.stage(f"Change {number + 1}"):
            change = _curves(canvas, local, shape)
            share = shares[channel]
            changes.append(_State(change.kd * share, change.ks * share, change.roughness * share))
    with canvas.stage("Gain · authored + offset + changes"):
        for plus in changes:
            kd, ks = offset.kd + plus.kd, offset.ks + plus.ks
            offset = _State(kd, ks, offset.roughness + plus.roughness)
        return _State(
            state.kd.scaled(gain.kd, offset.kd),
            state.ks.scaled(gain.ks, offset.ks),
            state.roughness.scaled(gain.roughness, offset.roughness),
        )


def _curves(canvas: Canvas, local: Number, curve: Array) -> _State:
    """One row of curves [T, 7] at the local age: a ramp for Kd and roughness, one for Ks."""
    kd, roughness = _ramp(canvas, local, curve[:, [0, 1, 2, 6]], "Kd, roughness as alpha")
    ks, _ = _ramp(canvas, local, curve[:, [3, 4, 5, 5]], "Ks")
    return _State(kd, ks, roughness)


def _ramp(canvas: Canvas, local: Number, curve: Array, label: str) -> tuple[Triple, Number]:
    """A curve [T, 4] as color and alpha."""
    stops = stops_of(curve)
    node = canvas.add("ShaderNodeValToRGB", local, label=label)
    elements = node.color_ramp.elements
    for position in stops.positions[1:-1]:
        elements.new(position)
    for element, value in zip(elements, stops.values, strict=True):
        element.color = value
    *span, alpha_span = stops.span
    *least, alpha_least = stops.least
    factor, offset = (span[0], span[1], span[2]), (least[0], least[1], least[2])
    color = Triple(canvas, node.outputs["Color"]).scaled(factor, offset)
    return color, Number(canvas, node.outputs["Alpha"]).scaled(alpha_span, alpha_least)


def _limited(canvas: Canvas, state: _State) -> _State:
    with canvas.stage("Limits"):
        none = (0.0, 0.0, 0.0)
        roughness = state.roughness.maximum(ROUGHNESS_MIN).minimum(1.0)
        return _State(state.kd.maximum(none), state.ks.maximum(none), roughness)


def _give_authored(
    canvas: Canvas, _start: _State, state: _State, local: Number
) -> tuple[Triple, Number, Number, Number]:
    """The sockets read back, and the artist's own to the last bit where nothing has aged yet."""
    with canvas.stage("Read back"):
        names = ("Base Color", "Metallic", "Specular IOR Level", "IOR", "Specular Tint")
        authored = tuple(canvas.number(each) for each in names)
        node = canvas.add(
            "ShaderNodeGroup", state.kd, state.ks, *authored, node_tree=read_back_group()
        )
        base = Triple(canvas, node.outputs["Base Color"])
        metallic, level = (
            Number(canvas, node.outputs[each]) for each in ("Metallic", "Specular IOR Level")
        )
    with canvas.stage(_UNTIL):
        aged = greater(local, 0.0)
        return (
            where3(aged, base, canvas.triple("Base Color")),
            where(aged, metallic, canvas.number("Metallic")),
            where(aged, state.roughness, canvas.number("Roughness")),
            where(aged, level, canvas.number("Specular IOR Level")),
        )


def _give_exact(
    canvas: Canvas, start: _State, state: _State, local: Number
) -> tuple[Triple, Triple, Number]:
    state = _give_torrance_sparrow(canvas, start, state, local)
    with canvas.stage("Read back, exact"):
        node = canvas.add("ShaderNodeGroup", state.kd, state.ks, node_tree=exact_group())
        base, tint = (Triple(canvas, each) for each in node.outputs)
        return base, tint, state.roughness


def _give_torrance_sparrow(canvas: Canvas, start: _State, state: _State, local: Number) -> _State:
    with canvas.stage(_UNTIL):
        aged = greater(local, 0.0)
        return _State(
            where3(aged, state.kd, start.kd),
            where3(aged, state.ks, start.ks),
            where(aged, state.roughness, start.roughness),
        )


_GIVE = {
    "principled": _give_authored,
    "principled-exact": _give_exact,
    "torrance-sparrow": _give_torrance_sparrow,
}
