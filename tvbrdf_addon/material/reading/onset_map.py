"""The map of when each texel starts to age, as the worker reads it: 0 at once, 1 last."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np

from ...errors import MaterialError
from ...known import known
from ..nodes.surface import find_principled
from .bake import Target, bake_sockets
from .doubts import baked_badly
from .evaluated import Evaluated, distinct, evaluated
from .lookup import Reading
from .onset import bearers, is_painted, showing, why_no_onset
from .passing import discard
from .pixels import Array, in_file, luminance, set_as_data, write_exr
from .space import image_size
from .tiles import Tiles
from .unwrap import active_uv_map, check_unwrapped, require_faces, shows

__all__ = ("Onset", "write_onset")

# What rounding may add to values from 0 to 1.
_ROUNDING = 1e-3
# More of an object's texels than borders cut.
_SHARED = 0.05


class Onset(NamedTuple):
    """Where the map lies, and what is to be said of it, a sentence each."""

    path: Path
    warnings: tuple[str, ...]


class _Bake(NamedTuple):
    """An object's shades [H, W], where its faces lie, and where these or their margin lie."""

    shades: Array
    inside: np.ndarray
    reach: np.ndarray


def write_onset(
    *,
    material: bpy.types.Material,
    scene: bpy.types.Scene,
    reading: Reading,
    folder: Path,
    frame: int,
) -> Onset:
    """The map that the image or the color attribute of the material's settings stands for.

    It is written to `folder`, which must exist; an image that lies on disk as it is meant is left
    there.  Raises `MaterialError`.
    """
    if reason := why_no_onset(material, scene):
        raise MaterialError(reason)
    settings = material.tvbrdf
    path = folder / "onset.exr"
    if is_painted(material):
        values, warnings = _painted(material, scene, reading, frame)
    else:
        image, warnings = settings.onset_image, []
        as_it_is = reading.tiles.are_one and not settings.onset_invert
        if as_it_is and _lies_on_disk(image):
            return Onset(_file_of(image), ())
        shades = _shades(image, reading.tiles)
        _check(shades, settings.onset_invert, f"The start image “{image.name}”")
        values = _meant(shades, settings.onset_invert)
    write_exr(path, values)
    return Onset(path, tuple(warnings))


def _file_of(image: bpy.types.Image) -> Path:
    return Path(bpy.path.abspath(image.filepath, library=image.library))


def _lies_on_disk(image: bpy.types.Image) -> bool:
    """Whether the image's file shows what Blender shows: nothing packed, nothing unsaved."""
    if image.source != "FILE" or image.is_dirty or image.packed_files:
        return False
    return _file_of(image).is_file()


def _shades(image: bpy.types.Image, tiles: Tiles) -> Array:
    """What an image says, in the tiles in which it does, or in each the same if it has none."""
    if min(image_size(image)) == 0:  # asking for the size loads it, if it can be
        raise MaterialError(
            f"The start image “{image.name}” cannot be loaded from {image.filepath or 'nowhere'}.",
            "Use File > External Data > Find Missing Files, or choose another image.",
        )
    if image.source != "TILED":
        shades = luminance(in_file(image))
        return tiles.put_together(dict.fromkeys(tiles.used, shades))
    if lacking := tiles.not_in(image):
        raise MaterialError(
            f"The start image “{image.name}” has no tile {', '.join(lacking)}.",
            "Add it in the Image Editor under Sidebar > Image > UDIM Tiles.",
        )
    with _emitter("ShaderNodeTexImage") as (material, node):
        node.image = image.copy()
        try:
            set_as_data(node.image)
            target = Target(material, tiles=tiles)
            maps, _ = bake_sockets(material, ["Metallic"], target, size=image_size(image), frame=1)
        finally:
            discard(node.image)
    return maps["Metallic"]


def _check(values: Array, invert: bool, whose: str) -> None:
    if not np.isfinite(values).all() or values.min() < -_ROUNDING or values.max() > 1 + _ROUNDING:
        first, last = ("white (1)", "black (0)") if invert else ("black (0)", "white (1)")
        raise MaterialError(
            f"{whose} has values outside 0 to 1.",
            f"Paint {first} where aging starts at once and {last} where it starts last.",
        )


def _meant(shades: Array, invert: bool) -> Array:
    """The start that shades stand for, rounding errors taken away."""
    shades = shades.clip(0, 1)
    return 1 - shades if invert else shades


def _painted(
    material: bpy.types.Material, scene: bpy.types.Scene, reading: Reading, frame: int
) -> tuple[Array, list[str]]:
    """The start [H, W] painted on all objects that show the material, and warnings.

    A texel is that of the first object that has a face there, else that of the first whose margin
    reaches it.  Where nothing was painted it is 1: nothing ages there before the end.
    """
    name, invert = material.tvbrdf.onset_attribute, material.tvbrdf.onset_invert
    tiles = reading.tiles
    size = (reading.textures.pixels,) * 2 if reading.uniform else reading.size
    tile = size[0] // tiles.rows, size[1] // tiles.columns
    onset = np.ones(size, np.float32)
    covered, reached = np.zeros(size, bool), np.zeros(size, bool)
    warnings = _left_out(material, scene, name)
    for obj in distinct(bearers(material, scene, name)):
        with evaluated(obj, frame) as look:
            if not shows(look, material):
                continue
            if name not in look.mesh.color_attributes or active_uv_map(look.mesh) is None:
                raise MaterialError(
                    f"The modifiers of “{obj.name}” leave no color attribute “{name}”, or no UV "
                    "map.",
                    "Apply them (Object > Convert > Mesh) and paint the result.",
                )
            uv_map = _uv_map(look, showing(material, scene), reading)
            require_faces(look, material, frame)
            if tiles.are_one:
                check_unwrapped(look, material, uv_map, max(size))
            # Before the bake, which makes nothing of what is negative.
            whose = f"The color attribute “{name}” of “{obj.name}”"
            _check(_attribute(look, name), invert, whose)
            target = Target(material, look, uv_map, tiles)
            baked = _bake(target, name, tile, frame)
            taken = (baked.reach & ~reached) | (baked.inside & ~covered)
            if np.count_nonzero(baked.inside & covered) > _SHARED * np.count_nonzero(baked.inside):
                warnings.append(
                    f"“{obj.name}” shares UVs with another object: what is painted there on the "
                    "other counts for both."
                )
            else:
                warnings += baked_badly(target, baked.inside)
        onset[taken] = _meant(baked.shades[taken], invert)
        covered |= baked.inside
        reached |= baked.reach
    if not covered.any():
        raise MaterialError(
            f"No face with the color attribute “{name}” shows “{material.name}”.",
            "Assign the material to some faces.",
        )
    return onset, warnings


def _left_out(material: bpy.types.Material, scene: bpy.types.Scene, name: str) -> list[str]:
    """A sentence where objects show the material and nothing can be painted on them."""
    bearing = bearers(material, scene, name)
    others = [obj.name for obj in showing(material, scene) if obj not in bearing]
    if not others:
        return []
    which = f"“{others[0]}”" if len(others) == 1 else f"{len(others)} other objects"
    return [
        f"{which} also show{'s' * (len(others) == 1)} “{material.name}”, but without a color "
        f"attribute “{name}” and UVs: where nothing else is painted it does not age."
    ]


def _uv_map(look: Evaluated, users: list[bpy.types.Object], reading: Reading) -> str:
    """The UV map by which the object will look its textures up: that of all users, or its own."""
    meshes = [look.mesh, *(user.data for user in users if user.type == "MESH")]
    if reading.uv_map and all(reading.uv_map in mesh.uv_layers for mesh in meshes):
        return reading.uv_map
    return known(active_uv_map(look.mesh))


def _attribute(look: Evaluated, name: str) -> Array:
    """The shades of all vertices or face corners."""
    data = look.mesh.color_attributes[name].data
    colors = np.empty(len(data) * 4, np.float32)
    data.foreach_get("color", colors)
    return luminance(colors.reshape(1, -1, 4)[..., :3])


def _bake(target: Target, attribute: str, size: tuple[int, int], frame: int) -> _Bake:
    with _emitter("ShaderNodeVertexColor") as (emitter, node):
        node.layer_name = attribute
        # Both numbers, so that one bake makes them.  Roughness is 1 as far as the margin reaches.
        maps, coverage = bake_sockets(
            emitter, ["Metallic", "Roughness"], target, size=size, frame=frame
        )
    return _Bake(maps["Metallic"], coverage > 0, maps["Roughness"] > 0.5)


@contextmanager
def _emitter(kind: str) -> Iterator[tuple[bpy.types.Material, bpy.types.Node]]:
    """A passing material whose Metallic is the color of a node, given too, and whose Roughness is
    another one's 1.
    """
    material = bpy.data.materials.new("tvbrdf onset")
    try:
        if bpy.app.version < (5, 0):
            material.use_nodes = True
        tree = material.node_tree
        place = find_principled(material)
        color = tree.nodes.new(kind)
        tree.links.new(color.outputs["Color"], place.input("Metallic"))
        one = tree.nodes.new("ShaderNodeValue")
        one.outputs[0].default_value = 1.0
        tree.links.new(one.outputs[0], place.input("Roughness"))
        yield material, color
    finally:
        discard(material)
