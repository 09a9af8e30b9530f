"""The node group of one aged material: the artist's values in, those of their local age out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np

from ....model_runtime.channels import ROUGHNESS_MIN, optics
from ....model_runtime.contract import (
    COEFFICIENTS_A_FILE,
    PRINCIPLED,
    PRINCIPLED_EXACT,
    TORRANCE_SPARROW,
)
from ....model_runtime.live.evaluate import Curves
from ...known import image_texture, known
from ..result import LiveFiles
from .arrange import arrange
from .formula import Canvas, Number, Numeric, Triple, dot, greater, where, where3
from .mapping import exact_group, forward_group, new_group, read_back_group
from .stops import Array, stops_of

__all__ = ("AUTHORED", "OUTPUTS", "aged_group")

AUTHORED = ("Base Color", "Metallic", "Roughness", "Specular IOR Level", "IOR", "Specular Tint")
"""The group's inputs that take what feeds the Principled BSDF."""

OUTPUTS = {
    PRINCIPLED: {
        "base_color": "Base Color",
        "metallic": "Metallic",
        "roughness": "Roughness",
        "specular": "Specular IOR Level",
    },
    PRINCIPLED_EXACT: {
        "base_color": "Base Color",
        "specular_tint": "Specular Tint",
        "roughness": "Roughness",
    },
    TORRANCE_SPARROW: {"kd": "Diffuse", "ks": "Specular", "alpha": "Roughness"},
}
"""What the group gives: by the format of the result the output of each map, in order."""

_NONE = (0.0, 0.0, 0.0)
_UNTIL = "As authored until something ages"

_HALF_ZERO = 2.0**-15
"""What Cycles makes of 0 in an image of half floats: so small a local age is none."""

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
    timing_map: str | None,
    load: Callable[[bpy.types.ShaderNodeTexImage, Path], None],
) -> bpy.types.NodeTree:
    """A group called `name` that ages by `maps` and their `curves`.

    `age` is the custom property by which an object may have an age of its own. With `vector` an
    input says where the textures are looked up, else the UV map does; `timing_map` names another UV
    map, by which the timing is. `load` lets a texture show a file.
    """
    inputs = (*AUTHORED, "Age", *(("Vector",) if vector else ()))
    group = new_group(name, inputs, tuple(OUTPUTS[maps.format].values()))
    _add_dead_end(group)
    canvas = Canvas(group)

    def shown(path: Path, label: str, *at: Triple) -> bpy.types.ShaderNodeTexImage:
        node = image_texture(canvas.add("ShaderNodeTexImage", *at, label=label))
        load(node, path)
        return node

    def texture(path: Path, label: str) -> Triple:
        at = (canvas.triple("Vector"),) if vector else ()
        return Triple(canvas, known(shown(path, label, *at).outputs)["Color"])

    def timing(path: Path, label: str) -> Triple:
        if timing_map is None:
            return texture(path, label)
        place = canvas.add("ShaderNodeUVMap", uv_map=timing_map, label=timing_map)
        node = shown(path, label, Triple(canvas, place.outputs["UV"]))
        node.projection, node.extension, node.interpolation = "FLAT", "EXTEND", "Linear"
        return Triple(canvas, known(node.outputs)["Color"])

    local = _local_age(canvas, age, maps.timing, timing)
    start = _forward(canvas)
    state = _changed(canvas, start, local, curves, maps.coefficients, texture)
    result = _GIVE[maps.format](canvas, start, state, local)
    with canvas.stage("Result"):
        canvas.give(dict(zip(OUTPUTS[maps.format].values(), result, strict=True)))
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
    """y(a) = G(a) y0 + O(a) + sum_k c_k V_k(a).

    As a ramp holds nothing below 0, O and V_k are raised by their depths D, at once for all
    channels, and O's and sum_k c_k D_k are taken off the sum.
    """
    with canvas.stage("Gain"):
        gain = _ramps(canvas, local, curves.gain)
    with canvas.stage("Offset"):
        depth = _depth(curves.offset)
        total = _ramps(canvas, local, curves.offset + depth)
    raised: Numeric = depth
    for number, shape in enumerate(curves.shapes):
        channel = number % COEFFICIENTS_A_FILE
        if channel == 0:
            with canvas.stage("Coefficients"):
                path = coefficients[number // COEFFICIENTS_A_FILE]
                texel = texture(path, "Coefficients")
                shares = texel.channels()
                depths = [_depth(each) for each in curves.shapes[number:][:COEFFICIENTS_A_FILE]]
                red, green, blue = depths + [0.0] * (COEFFICIENTS_A_FILE - len(depths))
                raised = dot(texel, (red, green, blue)) + raised
        with canvas.stage(f"+ coefficient · change {number + 1}"):
            change, share = _ramps(canvas, local, shape + depths[channel]), shares[channel]
            kd, ks = change.kd.scaled(share, total.kd), change.ks.scaled(share, total.ks)
            total = _State(kd, ks, change.roughness.scaled(share, total.roughness))
    with canvas.stage("Gain · authored + offset + changes, and its limits"):
        kd = state.kd.scaled(gain.kd, total.kd) - raised
        ks = state.ks.scaled(gain.ks, total.ks) - raised
        roughness = state.roughness.scaled(gain.roughness, total.roughness) - raised
        roughness = roughness.maximum(ROUGHNESS_MIN).minimum(1.0)
        return _State(kd.maximum(_NONE), ks.maximum(_NONE), roughness)


def _depth(curve: Array) -> float:
    return max(-float(curve.min()), 0.0)


def _ramps(canvas: Canvas, local: Number, curve: Array) -> _State:
    """One row of curves [T, C] at the local age: a ramp for Kd and roughness, one for Ks."""
    kd, ks, r = optics(curve)
    shown_kd, roughness = _ramp(canvas, local, np.column_stack((kd, r)), "Kd, roughness as alpha")
    shown_ks, _ = _ramp(canvas, local, np.column_stack((ks, ks[:, -1])), "Ks")
    return _State(shown_kd, shown_ks, roughness)


def _ramp(canvas: Canvas, local: Number, curve: Array, label: str) -> tuple[Triple, Number]:
    """A curve [T, 4] as color and alpha."""
    stops = stops_of(curve)
    node = canvas.add("ShaderNodeValToRGB", local, label=label)
    elements = node.color_ramp.elements
    for position in stops.positions[1:-1]:
        elements.new(position)
    for element, value in zip(elements, stops.values, strict=True):
        element.color = value
    return Triple(canvas, node.outputs["Color"]), Number(canvas, node.outputs["Alpha"])


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
        aged = greater(local, _HALF_ZERO)
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
        aged = greater(local, _HALF_ZERO)
        return _State(
            where3(aged, state.kd, start.kd),
            where3(aged, state.ks, start.ks),
            where(aged, state.roughness, start.roughness),
        )


_GIVE = {
    PRINCIPLED: _give_authored,
    PRINCIPLED_EXACT: _give_exact,
    TORRANCE_SPARROW: _give_torrance_sparrow,
}
