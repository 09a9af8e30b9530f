"""Binds a result to a material: live, or as image sequences or keyed sockets; Age moves it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import bpy

from ....model_runtime.channels import FURTHER_LOBES, LOBE
from ....model_runtime.contract import (
    HEIGHT,
    PRINCIPLED,
    PRINCIPLED_EXACT,
    TORRANCE_SPARROW,
)
from ...errors import MaterialError
from ..nodes.revert import revert
from ..nodes.trace import input_socket
from ..reading.check import why_no_surface
from ..reading.lookup import Reading
from ..result import AgedMaps, LiveFiles, read_result
from ..surface_maps.collect import UVMap
from .edit import Edit
from .live import Aged, aged_by_shader
from .relief import Show, with_relief

__all__ = ("bind", "bind_stills")

_AUTHORED = {
    "base_color": "Base Color",
    "metallic": "Metallic",
    "specular": "Specular IOR Level",
    "roughness": "Roughness",
    "normal": "Normal",
}
_EXACT = {
    "base_color": "Base Color",
    "specular_tint": "Specular Tint",
    "roughness": "Roughness",
    "normal": "Normal",
}
# F0 = ((17.94 - 1) / (17.94 + 1))^2 = 0.8, which Specular Tint then scales to Ks.
_EXACT_CONSTANTS = {"Metallic": 0.0, "IOR": 17.94, "Specular IOR Level": 0.5}
_LOBES = ("Coat Weight", "Sheen Weight", "Transmission Weight", "Subsurface Weight", "Anisotropic")


def bind(
    *,
    material: bpy.types.Material,
    reading: Reading,
    folder: Path,
    frame_start: int,
    frame_end: int,
    uv_map: UVMap | None = None,
) -> tuple[str, ...]:
    """Shows the result in `folder` (`aged.json` and its files) on `material`, over the frames.

    `uv_map` is one to be added to the meshes, by which the timing of a live result is looked up.
    An earlier aging is taken away first.  Nodes are only added and sockets relinked; the material
    keeps a record from which `revert` restores it.  Returns warnings, a sentence each.  Raises
    `MaterialError`; one about the result leaves the material untouched, one about its nodes leaves
    it as it was before aging.
    """
    if frame_end <= frame_start:
        raise MaterialError(
            f"Frames {frame_start} to {frame_end} are no range to age over.",
            "Choose a last frame after the first.",
        )
    result = read_result(folder)
    live = isinstance(result, LiveFiles)
    return _show(
        material,
        reading,
        partial(aged_by_shader if live else _frames, maps=result),
        format=result.format,
        span=(frame_start, frame_end),
        times=() if live else result.times,
        uv_map=uv_map if live and result.timing is not None else None,
        distance=result.unit.distance(reading.texture_side),
    )


def bind_stills(material: bpy.types.Material, reading: Reading, stills: AgedMaps) -> None:
    """Shows maps that have one file each, all of them and for good; Revert as after `bind`."""
    distance = stills.unit.distance(reading.texture_side)
    _show(material, reading, partial(_maps, maps=stills), format=stills.format, distance=distance)


def _show(
    material: bpy.types.Material,
    reading: Reading,
    aged: Callable[[Edit], Aged],
    *,
    format: str,
    distance: float,
    span: tuple[int, int] = (0, 1),
    times: Sequence[float] = (),
    uv_map: UVMap | None = None,
) -> tuple[str, ...]:
    revert(material)
    reason = why_no_surface(material)
    if reason:
        raise MaterialError(reason)
    edit = Edit(material, reading, span, times)
    try:
        if uv_map is not None:
            edit.give_uv_map(uv_map)
        warnings = _FORMATS[format](edit, _relieved(edit, aged(edit), distance))
    except Exception:
        edit.finish()
        revert(material)
        raise
    edit.finish()
    material.tvbrdf.keyed = span
    return tuple(warnings)


def _relieved(edit: Edit, aged: Aged, distance: float) -> Aged:
    """What is shown, with the normal in the place of a height, of which one is `distance` high."""
    rest = {name: show for name, show in aged.items() if name != HEIGHT}
    normal = with_relief(edit, aged[HEIGHT], distance) if HEIGHT in aged else None
    return {**rest, "normal": normal} if normal is not None else rest


def _maps(edit: Edit, maps: AgedMaps) -> Aged:
    all_maps = (*maps.maps, *((maps.height,) if maps.height is not None else ()))
    return {
        each.name: partial(
            edit.show, each, transform=math.sqrt if each.name.endswith("alpha") else None
        )
        for each in all_maps
    }


def _frames(edit: Edit, maps: AgedMaps) -> Aged:
    """The maps over time.  As authored, what never changes keeps what fed it."""
    kept = {each.name for each in maps.maps if not each.changes and maps.format == PRINCIPLED}
    return {name: show for name, show in _maps(edit, maps).items() if name not in kept}


def _bind_authored(edit: Edit, aged: Aged) -> list[str]:
    """The artist's parameters, changed."""
    for name, show in aged.items():
        show(edit.input(_AUTHORED[name]))
    return []


def _bind_exact(edit: Edit, aged: Aged) -> list[str]:
    """A flat Fresnel term on the Principled BSDF: F0 = 0.8 times Specular Tint = Ks."""
    edit.use_ggx()
    for identifier, value in _EXACT_CONSTANTS.items():
        edit.fix(edit.input(identifier), value)
    for name, show in aged.items():
        show(edit.input(_EXACT[name]))
    return []


def _bind_torrance_sparrow(edit: Edit, aged: Aged) -> list[str]:
    """Diffuse and Glossy BSDF added, which have no Fresnel term and no bound on Ks."""
    diffuse = edit.layout.add("ShaderNodeBsdfDiffuse", "Diffuse", column=-1, row=0)
    glossy = edit.layout.add("ShaderNodeBsdfAnisotropic", "Specular", column=-1, row=1)
    glossy.distribution = "GGX"
    both = edit.layout.add("ShaderNodeAddShader", "Diffuse and Specular", column=-2, row=0)
    normal = aged.get("normal", partial(edit.follow, "Normal"))
    for shader, slot in zip((diffuse, glossy), both.inputs, strict=True):
        edit.tree.links.new(shader.outputs[0], slot)
        normal(shader.inputs["Normal"])
    aged["kd"](diffuse.inputs["Color"])
    aged["ks"](glossy.inputs["Color"])
    aged["alpha"](glossy.inputs["Roughness"])
    shown = both.outputs[0]
    for number, lobe in enumerate(_further(aged), start=2):
        shown = _with_lobe(edit, shown, lobe, normal, f"Lobe {number}", row=3 * number - 4)
    surface = _with_transparency(edit, _with_emission(edit, shown))
    edit.replace_shader(surface)
    lost = [each for each in _LOBES if _used(edit.input(each), 0.0)]
    if not lost:
        return []
    return [
        f"“{edit.material.name}” is bound as Diffuse and Glossy BSDF, which leaves out its "
        f"{', '.join(each.removesuffix(' Weight').lower() for each in lost)}."
    ]


def _further(aged: Aged) -> Iterator[Aged]:
    """What shows the parts of each of the lobes after the first (`LOBE`)."""
    for which in FURTHER_LOBES:
        names = {part: f"{which}_{part}" for part in LOBE}
        lobe = {part: aged[name] for part, name in names.items() if name in aged}
        if lobe:
            yield lobe


def _with_lobe(
    edit: Edit,
    surface: bpy.types.NodeSocket,
    lobe: Aged,
    normal: Show,
    name: str,
    row: int,
) -> bpy.types.NodeSocket:
    """`surface` and a metal added, as much of it as its weight says."""
    metal = edit.layout.add("ShaderNodeBsdfPrincipled", name, column=-3, row=row)
    metal.distribution = "GGX"
    metal.inputs["Metallic"].default_value = 1.0
    weighed = edit.layout.add("ShaderNodeMixShader", f"{name}, Weight", column=-4, row=row)
    both = edit.layout.add("ShaderNodeAddShader", f"Add {name}", column=-5, row=row)
    edit.tree.links.new(metal.outputs[0], weighed.inputs[2])
    edit.tree.links.new(surface, both.inputs[0])
    edit.tree.links.new(weighed.outputs[0], both.inputs[1])
    _show_base(edit, lobe, metal.inputs["Base Color"], normal, name, row)
    lobe["weight"](weighed.inputs["Fac"])
    lobe["alpha"](metal.inputs["Roughness"])
    normal(metal.inputs["Normal"])
    return both.outputs[0]


def _show_base(
    edit: Edit, lobe: Aged, base: bpy.types.NodeSocket, normal: Show, name: str, row: int
) -> None:
    """The color of a lobe, which turns to that of its edge, where it has one, as the view grazes
    it: at a Blend of 0.5 Facing is 1 - cos theta_o.
    """
    if "edge" not in lobe:
        lobe["color"](base)
        return
    facing = edit.layout.add("ShaderNodeLayerWeight", f"{name}, Facing", column=-2, row=row + 1)
    turned = edit.layout.add("ShaderNodeMix", f"{name}, Edge", column=-2, row=row)
    turned.data_type = "RGBA"
    facing.inputs["Blend"].default_value = 0.5
    normal(facing.inputs["Normal"])
    edit.tree.links.new(facing.outputs["Facing"], input_socket(turned, "Factor_Float"))
    lobe["color"](input_socket(turned, "A_Color"))
    lobe["edge"](input_socket(turned, "B_Color"))
    result = next(each for each in turned.outputs if each.identifier == "Result_Color")
    edit.tree.links.new(result, base)


_FORMATS = {
    PRINCIPLED: _bind_authored,
    PRINCIPLED_EXACT: _bind_exact,
    TORRANCE_SPARROW: _bind_torrance_sparrow,
}


def _with_emission(edit: Edit, surface: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    if not _used(edit.input("Emission Strength"), 0.0):
        return surface
    emission = edit.layout.add("ShaderNodeEmission", "Emission", column=-2, row=1)
    edit.follow("Emission Color", emission.inputs["Color"])
    edit.follow("Emission Strength", emission.inputs["Strength"])
    both = edit.layout.add("ShaderNodeAddShader", "Add Emission", column=-3, row=0)
    edit.tree.links.new(surface, both.inputs[0])
    edit.tree.links.new(emission.outputs[0], both.inputs[1])
    return both.outputs[0]


def _with_transparency(edit: Edit, surface: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    if not _used(edit.input("Alpha"), 1.0):
        return surface
    transparent = edit.layout.add("ShaderNodeBsdfTransparent", "Transparent", column=-3, row=1)
    mix = edit.layout.add("ShaderNodeMixShader", "Alpha", column=-4, row=0)
    edit.follow("Alpha", mix.inputs["Fac"])
    edit.tree.links.new(transparent.outputs[0], mix.inputs[1])
    edit.tree.links.new(surface, mix.inputs[2])
    return mix.outputs[0]


def _used(socket: bpy.types.NodeSocket, neutral: float) -> bool:
    return socket.is_linked or socket.default_value != neutral
