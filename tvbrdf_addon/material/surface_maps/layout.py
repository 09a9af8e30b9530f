"""Where timing lies: in the material's own UV map, or where places share its texels in one made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ..nodes.uv_maps import owned_uv_map
from ..reading.passing import discard
from ..reading.tiles import Tiles
from ..reading.unwrap import active_uv_map
from .charts import Faces, laid_out
from .collect import Seen, UVMap, collect
from .parts import Part
from .raster import Raster, rasterize

__all__ = ("Layout", "free_name", "lay_out")

Array = NDArray[np.float32]

# Of the texels that faces cover, how many may show two of them: those that borders cut.
_SHARED = 0.02
# Of a texel, how far UVs may reach out of the map before they count as repeated.
_BEYOND = 0.5
# Of the map, how much of what is not the same triangle again is looked at.
_MOST_LAYERS = 3.0
_MOST_UV_MAPS = 8
_NAME = "Age"
_LOOKED_AT = 512  # texels a side


@dataclass(frozen=True)
class Layout:
    """What shows a material, and where in a map: `raster` counts the triangles of all parts.

    `own` is the UV map that was made for it, which the meshes do not have yet; None where it is
    the material's.  `notes` are sentences.
    """

    seen: Seen
    uv: Array
    raster: Raster
    own: UVMap | None
    notes: tuple[str, ...]


def lay_out(
    seen: Seen,
    material: bpy.types.Material,
    scene: bpy.types.Scene,
    frame: int,
    *,
    uv_map: str | None,
    tiles: Tiles,
    alike: bool,
    name: str,
    size: int,
) -> Layout | tuple[str, ...]:
    """The layout of maps of `size` texels a side, or sentences why there is none.

    `uv_map` is that by which the material looks up what is made of it (empty: that which each mesh
    renders with), None where it does so by something else; `seen` was collected by it.  Faces that
    share texels have places of their own unless they are to age `alike`.  `name` is what a UV map
    is called that has to be made.
    """
    notes = _not_followed(material, seen)
    if not seen.parts:
        return notes
    if uv_map is None:
        why = f"“{material.name}” is not laid out by a UV map"
    elif (part := next((each for each in seen.parts if _is_flat(each)), None)) is not None:
        why = f"“{part.obj.name}” has no UV map with an area"
    else:
        uv = _among(tiles, np.concatenate([part.uv for part in seen.parts if part.uv is not None]))
        shape = _shape(tiles, size)
        if _leaves(uv, shape):
            why = f"The UV map of “{material.name}” repeats its textures"
        else:
            found = _seen_once(uv, shape)
            if found is not None and not found.shared:
                return Layout(seen, uv, found.raster, None, (*notes, *_alike(seen.parts)))
            if found is not None and alike:
                return Layout(seen, uv, found.raster, None, (*notes, _AS_ASKED))
            if found is not None and not _share_texels(seen.parts, material, uv_map, tiles):
                notes = (*notes, *_alike(seen.parts), _COPIES)
                return Layout(seen, uv, found.raster, None, notes)
            why = f"Faces of “{material.name}” lie on one another in its UV map"
    return _apart(material, scene, frame, seen, name, size, why, notes)


_AS_ASKED = "What shares texels ages alike, as Mirrored Alike says: by where its first face lies."
_COPIES = (
    "Copies that modifiers make of a mesh share its UV map and age alike: apply the modifiers "
    "where they are to differ."
)


def _not_followed(material: bpy.types.Material, seen: Seen) -> tuple[str, ...]:
    if not seen.no_meshes:
        return ()
    return (
        f"“{seen.no_meshes[0].name}” is no mesh, so that the aging of “{material.name}” cannot "
        "follow its shape: use Object > Convert > Mesh.",
    )


def _alike(parts: Sequence[Part]) -> tuple[str, ...]:
    """That objects have no texels of their own."""
    more = sum(part.others for part in parts)
    if not more:
        return ()
    name = next(part.obj.name for part in parts if part.others)
    return (
        f"{more} linked duplicate{'s' * (more > 1)} or instances of “{name}” age as it does, "
        "because they share its mesh: use Object > Relations > Make Single User where they are to "
        "differ.",
    )


def _is_flat(part: Part) -> bool:
    """Whether most of a part's surface has no place in its UV map."""
    if part.uv is None:
        return True
    flat = _uv_areas(part.uv) < 5e-13
    a, b, c = np.moveaxis(part.faces.corners.astype(np.float64), 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return bool(area[flat].sum() > area.sum() / 2)


def _among(tiles: Tiles, uv: Array) -> Array:
    """UVs in the one image of all tiles."""
    size = np.array((tiles.columns, tiles.rows), np.float32)
    return (uv - np.array(tiles.corner, np.float32)) / size


def _shape(tiles: Tiles, size: int) -> tuple[int, int]:
    """The (height, width) of a map of all tiles, with about as many texels as one of `size`."""
    side = max(round(size / np.sqrt(tiles.rows * tiles.columns)), 1)
    return tiles.whole((side, side))


def _leaves(uv: Array, shape: tuple[int, int]) -> bool:
    beyond = np.array((_BEYOND / shape[1], _BEYOND / shape[0]))
    return bool((uv < -beyond).any() or (uv > 1 + beyond).any())


class _Once(NamedTuple):
    """The first at each place of all triangles, and whether more than a few others lie there."""

    raster: Raster
    shared: bool


def _seen_once(uv: Array, shape: tuple[int, int]) -> _Once | None:
    """What a map shows of triangles [T, 3, 2]; None where they lie on one another many times."""
    areas = _uv_areas(uv)
    first = np.sort(np.unique(uv.reshape(len(uv), -1), axis=0, return_index=True)[1])
    if areas[first].sum() > _MOST_LAYERS:
        return None
    raster = rasterize(uv[first], shape)
    raster = replace(raster, triangles=first[raster.triangles])
    again = areas.sum() - areas[first].sum()
    shared = np.count_nonzero(raster.shared) > _SHARED * max(np.count_nonzero(raster.centers), 1)
    return _Once(raster, bool(shared or again > _SHARED * areas.sum()))


def _share_texels(
    parts: Sequence[Part], material: bpy.types.Material, uv_map: str, tiles: Tiles
) -> bool:
    """Whether the meshes without modifiers do, which could be laid out apart."""
    bases = [_Base.of(part, material, uv_map) for part in _of_meshes(parts)]
    uv = np.concatenate([base.uv for base in bases if base.uv is not None])
    found = _seen_once(_among(tiles, uv), _shape(tiles, _LOOKED_AT))
    return found is None or found.shared


def _uv_areas(uv: Array) -> NDArray[np.float64]:
    a, b, c = np.moveaxis(uv.astype(np.float64), 1, 0)
    first, second = b - a, c - a
    return np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2


def _of_meshes(parts: Sequence[Part]) -> list[Part]:
    """One part of those that are made of the same mesh."""
    return list({part.obj.data: part for part in reversed(parts)}.values())[::-1]


@dataclass(frozen=True)
class _Base:
    """The faces of a mesh, before modifiers, that show the material: with the numbers of their
    corners [T, 3] of so many, and with UVs [T, 3, 2] where it has them.
    """

    faces: Faces
    corners: NDArray[np.int64]
    count: int
    uv: Array | None

    @classmethod
    def of(cls, part: Part, material: bpy.types.Material, uv_map: str) -> _Base:
        mesh = part.obj.data
        assert isinstance(mesh, bpy.types.Mesh)
        copy = mesh.copy()
        try:
            copy.calc_loop_triangles()
            count = len(copy.loop_triangles)
            vertices, loops = np.empty((2, count * 3), np.int32)
            polygons, slots = np.empty((2, count), np.int32)
            for name, values in (
                ("vertices", vertices),
                ("loops", loops),
                ("polygon_index", polygons),
                ("material_index", slots),
            ):
                copy.loop_triangles.foreach_get(name, values)
            places = np.empty(len(copy.vertices) * 3, np.float32)
            copy.vertices.foreach_get("co", places)
            name = uv_map if uv_map in copy.uv_layers else active_uv_map(copy)
            uv = None
            if name is not None:
                uv = np.empty(len(copy.loops) * 2, np.float32)
                copy.uv_layers[name].data.foreach_get("uv", uv)
                uv = np.nan_to_num(uv.reshape(-1, 2))
            corners = len(copy.loops)
        finally:
            discard(copy)
        marked = np.array([slot.material == material for slot in part.obj.material_slots] or [True])
        shows = marked[slots.clip(0, len(marked) - 1)]
        if not shows.any():  # nodes say what does
            shows[:] = True
        vertices, loops = vertices.reshape(-1, 3)[shows], loops.reshape(-1, 3)[shows]
        world = _in_world(places.reshape(-1, 3), part.matrix)
        faces = Faces(
            np.nan_to_num(world)[vertices],
            vertices.astype(np.int64),
            polygons[shows].astype(np.int64),
        )
        return cls(faces, loops.astype(np.int64), corners, None if uv is None else uv[loops])


def _in_world(places: Array, matrix: mathutils.Matrix) -> Array:
    world = np.array(matrix, np.float64)
    return (places @ world[:3, :3].T + world[:3, 3]).astype(np.float32)


def _apart(
    material: bpy.types.Material,
    scene: bpy.types.Scene,
    frame: int,
    seen: Seen,
    name: str,
    size: int,
    why: str,
    notes: tuple[str, ...],
) -> Layout | tuple[str, ...]:
    """The layout in a UV map of its own."""
    parts = _of_meshes(seen.parts)
    if (reason := _why_no_uv_map(parts, name)) is not None:
        return (*notes, f"{why}, so that its aging cannot follow its shape: {reason}")
    bases = [_Base.of(part, material, "") for part in parts]
    places = laid_out([base.faces for base in bases], size)
    if places is None:
        return (*notes, f"{why}, and it has too many faces for a UV map of its own.")
    own: dict[int, Array] = {}
    for part, base, uv in zip(parts, bases, places, strict=True):
        own[part.obj.data.session_uid] = at = np.zeros((base.count, 2), np.float32)
        at[base.corners] = uv
    uv_map = UVMap(name, own)
    seen = collect(material, scene, frame, given=uv_map, mask=seen.mask)
    lost = [part for part in seen.parts if part.uv is None or _is_flat(part)]
    if lost:
        notes = (
            *notes,
            f"The modifiers of “{lost[0].obj.name}” leave no UV map, so that its aging cannot "
            "follow its shape: apply them (Object > Convert > Mesh).",
        )
        there = zip(seen.shown, seen.parts, strict=True)
        seen = replace(seen, shown=tuple(each for each, part in there if part not in lost))
    if not seen.parts:
        return notes
    uv = np.concatenate([part.uv for part in seen.parts if part.uv is not None])
    found = _seen_once(uv, (size, size))
    if found is None:
        return (*notes, _COPIES)
    notes = (
        *notes,
        f"{why}: when its places age lies in a UV map of its own, “{uv_map.name}”.",
        *_alike(seen.parts),
    )
    if found.shared:
        notes = (*notes, _COPIES)
    return Layout(seen, uv, found.raster, uv_map, notes)


def _why_no_uv_map(parts: Sequence[Part], uv_map: str) -> str | None:
    """Why no UV map of that name can be added to the meshes, or None if one can."""
    for part in parts:
        mesh, name = part.obj.data, f"“{part.obj.name}”"
        assert isinstance(mesh, bpy.types.Mesh)
        if mesh.library or mesh.override_library:
            return f"the mesh of {name} is linked from another file, and needs another UV map."
        if mesh.is_editmode:
            return f"leave Edit Mode of {name}, whose mesh needs another UV map, and age it again."
        if len(mesh.uv_layers) >= _MOST_UV_MAPS and uv_map not in mesh.uv_layers:
            return f"{name} has as many UV maps as it can have, and needs another; remove one."
    return None


def free_name(material: bpy.types.Material) -> str:
    """What a UV map made for a material is called: as the one before, or as no attribute of any
    mesh is.
    """
    if (before := owned_uv_map(material)) is not None:
        return before
    taken = {each.name for mesh in bpy.data.meshes for each in mesh.attributes}
    names = (f"{_NAME} {i}" if i > 1 else _NAME for i in range(1, len(taken) + 2))
    return next(each for each in names if each not in taken)
