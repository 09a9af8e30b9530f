"""UDIM tiles: which of them a material needs, and where they lie in the one image made of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ...errors import MaterialError
from ..nodes.trace import SOCKETS, input_socket, upstream
from .evaluated import distinct, evaluated, in_view
from .space import Space, looked_up_by
from .unwrap import active_uv_map, triangles

__all__ = ("Tile", "Tiles", "tiles_of")

Array = NDArray[np.float32]
Tile = tuple[int, int]

# UDIM: tile 1001 + u + 10 v.
_FIRST, _COLUMNS = 1001, 10
# Faces end on the borders of tiles, and rounding may move them across.
_INNER = 1 - 1e-3


@dataclass(frozen=True)
class Tiles:
    """Squares of UV space that textures are made for, in one image that lie in it as they do there.

    `used` are their lower left corners (u, v); the image is the rectangle around them.  `lacking`
    names squares on which faces lie, but no image.
    """

    used: tuple[Tile, ...] = ((0, 0),)
    lacking: tuple[str, ...] = ()

    @property
    def are_one(self) -> bool:
        """Whether they are the usual square from 0 to 1, which the image shows as it is."""
        return self.used == ((0, 0),)

    @property
    def corner(self) -> Tile:
        """The image's lower left corner."""
        return min(u for u, _ in self.used), min(v for _, v in self.used)

    @property
    def columns(self) -> int:
        return max(u for u, _ in self.used) - self.corner[0] + 1

    @property
    def rows(self) -> int:
        return max(v for _, v in self.used) - self.corner[1] + 1

    def whole(self, size: tuple[int, int]) -> tuple[int, int]:
        """The image's (height, width), where a tile has `size`."""
        return size[0] * self.rows, size[1] * self.columns

    def not_in(self, image: bpy.types.Image) -> list[str]:
        """The numbers of those that a tiled image lacks."""
        return [_name(tile) for tile in self.used if tile not in _tiles_in(image)]

    def put_together(self, parts: Mapping[Tile, Array], *, beside: float | None = None) -> Array:
        """The image whose tiles, all of one size [H, W] or [H, W, C], are `parts`.

        What is between the used ones is `beside`, or shows the first of them again, which adds
        nothing new.
        """
        left, bottom = self.corner
        first = parts[self.used[0]]
        if beside is not None:
            first = np.full_like(first, beside)
        rows = [
            np.concatenate(
                [parts.get((left + u, bottom + v), first) for u in range(self.columns)], 1
            )
            for v in reversed(range(self.rows))
        ]
        return np.concatenate(rows) if len(rows) > 1 else rows[0]


def tiles_of(
    principled: bpy.types.Node,
    space: Space,
    material: bpy.types.Material,
    objects: Sequence[bpy.types.Object],
    at: int | bpy.types.Depsgraph,
) -> Tiles:
    """The tiles that `objects` need of the images behind the sockets of `principled`.

    These are those on which faces with `material` lie that are rendered `at` a frame, or that a
    view shows, or all where the images are not looked up by UV alone; the usual square where no
    image has tiles.  Raises `MaterialError` where the images have none of those that are needed.
    """
    images = _tiled_images(principled, space.groups)
    if not images:
        return Tiles()
    there = set.intersection(*map(_tiles_in, images))
    uv_map = looked_up_by(space)
    needed = set() if uv_map is None else _touched(objects, material, uv_map, at)
    used = needed & there if needed else there
    if not used:
        raise MaterialError(
            f"No face of “{material.name}” lies on a tile that its images have.",
            "Choose the images and the UV map that belong together.",
        )
    return Tiles(tuple(sorted(used)), tuple(map(_name, sorted(needed - there))))


def _tiled_images(
    principled: bpy.types.Node, groups: Sequence[bpy.types.Node]
) -> list[bpy.types.Image]:
    sockets = (input_socket(principled, identifier) for identifier in SOCKETS.values())
    nodes = (node for socket in sockets for node, _ in upstream(socket, groups))
    images = (node.image for node in nodes if node.type == "TEX_IMAGE" and node.image is not None)
    return list({image.name_full: image for image in images if image.source == "TILED"}.values())


def _tiles_in(image: bpy.types.Image) -> set[Tile]:
    """Those that an image has and that can be loaded."""
    places = (divmod(each.number - _FIRST, _COLUMNS) for each in image.tiles if min(each.size))
    return {(column, row) for row, column in places}


def _name(tile: Tile) -> str:
    """Its UDIM number, or its corner where that has none."""
    u, v = tile
    return str(_FIRST + u + _COLUMNS * v) if 0 <= u < _COLUMNS and v >= 0 else f"u {u}, v {v}"


def _touched(
    objects: Iterable[bpy.types.Object],
    material: bpy.types.Material,
    uv_map: str,
    at: int | bpy.types.Depsgraph,
) -> set[Tile]:
    """The tiles in which triangles have a corner or their center."""
    found: set[Tile] = set()
    for obj in distinct(objects):
        if obj.type != "MESH" or obj.hide_render:
            continue
        uv = _uv_of(obj, material, uv_map, at)
        center = uv.mean(1, keepdims=True)
        places = np.concatenate((center + _INNER * (uv - center), center), 1).reshape(-1, 2)
        places = places[np.isfinite(places).all(1)]
        found |= {(int(u), int(v)) for u, v in np.unique(np.floor(places), axis=0)}
    return found


def _uv_of(
    obj: bpy.types.Object,
    material: bpy.types.Material,
    uv_map: str,
    at: int | bpy.types.Depsgraph,
) -> Array:
    """The triangles that show the material, in its UV map: [T, 3, 2], none where there is none."""
    with ExitStack() as stack:
        if isinstance(at, int):
            mesh = stack.enter_context(evaluated(obj, at)).mesh
            materials = list(mesh.materials)
        else:
            mesh, materials = stack.enter_context(in_view(obj, at))
        name = uv_map or active_uv_map(mesh)
        if name is None or name not in mesh.uv_layers:
            return np.empty((0, 3, 2), np.float32)
        return triangles(mesh, [each == material for each in materials], name)[1]
