"""The node group of one aged material: the artist's values in, those of their local age out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import bpy
import numpy as np

from ....model_runtime.channels import LOBE, lobe_maps, turning
from ....model_runtime.contract import (
    HEIGHT,
    PRINCIPLED,
    PRINCIPLED_EXACT,
    TORRANCE_SPARROW,
)
from ....model_runtime.live.evaluate import Curves
from ....model_runtime.maps import Pixels
from ...known import image_texture, known
from ..nodes.strengths import GRAIN
from ..result import LiveFiles
from .arrange import arrange
from .changes import State, Texel, Texture, changed, ramp
from .formula import Canvas, Number, Triple, greater, where, where3
from .mapping import exact_group, forward_group, new_group, read_back_group

__all__ = ("AUTHORED", "aged_group", "outputs_of")

AUTHORED = ("Base Color", "Metallic", "Roughness", "Specular IOR Level", "IOR", "Specular Tint")
"""The group's inputs that take what feeds the Principled BSDF."""

_OUTPUTS = {
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

_UNTIL = "As authored until something ages"

_HALF_ZERO = 1.001 * 2.0**-15
"""What Cycles makes of 0 in an image of half floats, and a little, by which it misses that between
texels: so small a local age is none.
"""


def outputs_of(maps: LiveFiles, lobes: Pixels | None) -> dict[str, str]:
    """What the group of a result gives, in order: the output of each map, by its name; those of the
    further `lobes` [K, T, 8] among them.

    A height is one in the result's unit.
    """
    further = {name: _lobe_output(name) for name in lobe_maps(_turns(lobes))}
    return {**_OUTPUTS[maps.format], **further, **({HEIGHT: "Height"} if maps.height else {})}


def _turns(lobes: Pixels | None) -> list[bool]:
    """Of each whether its color ever turns with the view."""
    return [] if lobes is None else turning(lobes).any(1).tolist()


def _lobe_output(name: str) -> str:
    """Of "second_alpha" "Second Roughness"."""
    return name.replace("alpha", "roughness").replace("_", " ").title()


def aged_group(
    name: str,
    maps: LiveFiles,
    curves: Curves,
    lobes: Pixels | None,
    *,
    age: str,
    vector: bool,
    timing_map: str | None,
    load: Callable[[bpy.types.ShaderNodeTexImage, Path], None],
) -> bpy.types.NodeTree:
    """A group called `name` that ages by `maps` and their `curves`, of a measurement of several
    lobes also by those of the further `lobes` [K, T, 8].

    `age` is the custom property by which an object may have an age of its own. With `vector` an
    input says where the textures are looked up, else the UV map does; `timing_map` names another UV
    map, by which the timing is. `load` lets a texture show a file.
    """
    inputs = (*AUTHORED, "Age", *((GRAIN,) if maps.grain else ()), *(("Vector",) if vector else ()))
    outputs = tuple(outputs_of(maps, lobes).values())
    group = new_group(name, inputs, outputs)
    _add_dead_end(group)
    canvas = Canvas(group)

    def shown(path: Path, label: str, *at: Triple) -> bpy.types.ShaderNodeTexImage:
        node = image_texture(canvas.add("ShaderNodeTexImage", *at, label=label))
        load(node, path)
        return node

    def texel(node: bpy.types.ShaderNodeTexImage) -> Texel:
        color, alpha = (known(node.outputs)[each] for each in ("Color", "Alpha"))
        return Texel(Triple(canvas, color), Number(canvas, alpha))

    def texture(path: Path, label: str) -> Texel:
        at = (canvas.triple("Vector"),) if vector else ()
        return texel(shown(path, label, *at))

    def timing(path: Path, label: str) -> Texel:
        if timing_map is None:
            return texture(path, label)
        place = canvas.add("ShaderNodeUVMap", uv_map=timing_map, label=timing_map)
        node = shown(path, label, Triple(canvas, place.outputs["UV"]))
        node.projection, node.extension, node.interpolation = "FLAT", "EXTEND", "Linear"
        return texel(node)

    local = _local_age(canvas, age, maps.timing, timing)
    start = _forward(canvas)
    state, height = changed(canvas, start, local, curves, maps, texture)
    if lobes is None:
        result = _GIVE[maps.format](canvas, start, state, local)
    else:
        result = (*state, *_further(canvas, local, lobes))
    if height is not None:
        with canvas.stage("Flat until something ages"):
            result = (*result, where(greater(local, _HALF_ZERO), height, 0.0))
    with canvas.stage("Result"):
        canvas.give(dict(zip(outputs, result, strict=True)))
    arrange(group)
    return group


def _further(canvas: Canvas, local: Number, lobes: Pixels) -> Iterator[Triple | Number]:
    """Color, edge where that is another, weight and roughness of each of the lobes after the first,
    at the local age.
    """
    for number, (lobe, turns) in enumerate(zip(lobes, _turns(lobes), strict=True), start=2):
        color, edge, weight, roughness = (lobe[:, place] for place in LOBE.values())
        with canvas.stage(f"Lobe {number}"):
            shown = np.column_stack((color, roughness))
            color, roughness = ramp(canvas, local, shown, "Color, roughness as alpha")
            shown = np.column_stack((edge, weight))
            edge, weight = ramp(canvas, local, shown, "Edge, weight as alpha")
        yield from (color, *((edge,) if turns else ()), weight, roughness)


def _add_dead_end(group: bpy.types.NodeTree) -> None:
    """A first Group Output, which is not the active one: the glTF exporter looks no further.

    It would follow every path through the nodes behind the other, of which there are millions.
    """
    end = group.nodes.new("NodeGroupOutput")
    end.label, end.hide, end.location = "glTF looks no further", True, (0, 200)


def _local_age(canvas: Canvas, age: str, timing: Path | None, texture: Texture) -> Number:
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
        onset, rate, start = texture(timing, "Onset, rate, start").color.channels()
        return (t - onset).maximum(0.0).scaled(rate, start).clamp()


def _forward(canvas: Canvas) -> State:
    with canvas.stage("As authored"):
        names = ("Base Color", "Metallic", "Specular IOR Level", "IOR", "Specular Tint")
        authored = tuple(canvas.number(each) for each in names)
        node = canvas.add("ShaderNodeGroup", *authored, node_tree=forward_group())
        kd, ks = (Triple(canvas, each) for each in node.outputs)
        return State(kd, ks, canvas.number("Roughness").clamp())


def _give_authored(
    canvas: Canvas, _start: State, state: State, local: Number
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
    canvas: Canvas, start: State, state: State, local: Number
) -> tuple[Triple, Triple, Number]:
    state = _give_torrance_sparrow(canvas, start, state, local)
    with canvas.stage("Read back, exact"):
        node = canvas.add("ShaderNodeGroup", state.kd, state.ks, node_tree=exact_group())
        base, tint = (Triple(canvas, each) for each in node.outputs)
        return base, tint, state.roughness


def _give_torrance_sparrow(canvas: Canvas, start: State, state: State, local: Number) -> State:
    with canvas.stage(_UNTIL):
        aged = greater(local, _HALF_ZERO)
        return State(
            where3(aged, state.kd, start.kd),
            where3(aged, state.ks, start.ks),
            where(aged, state.roughness, start.roughness),
        )


_GIVE = {
    PRINCIPLED: _give_authored,
    PRINCIPLED_EXACT: _give_exact,
    TORRANCE_SPARROW: _give_torrance_sparrow,
}
