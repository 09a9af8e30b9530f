"""The maps of a surface's layout: what lies at its texels, and what shelters that."""

from __future__ import annotations

from pathlib import Path

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ....model_runtime.reading.coverage import nearest_covered
from ....model_runtime.resampling import any_within
from ..reading.pixels import write_exr
from .layout import Layout
from .raster import Raster
from .shelter import shelter

__all__ = ("shrunk", "with_margin", "write_maps")

Array = NDArray[np.float32]
Marks = NDArray[np.bool_]

# Texels a side of what is baked, at most.
_BAKED = 384
# How far what is next to faces goes on, in texels.
_MARGIN = 16


def write_maps(layout: Layout, folder: Path) -> None:
    """Writes the maps of a layout into a folder.  Raises `MaterialError` where Cycles fails."""
    parts, raster = layout.seen.parts, layout.raster
    corners = np.concatenate([part.faces.corners for part in parts])
    position = raster.values(corners)
    normal = raster.values(np.concatenate([part.normals for part in parts]))
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    covered = raster.covered
    beside = nearest_covered(covered, reach=_MARGIN)
    alpha = covered.astype(np.float32)[..., None]
    for name, values in (("position", position), ("normal", normal)):
        pixels = _beyond(raster.image(values), beside)
        write_exr(folder / f"{name}.exr", np.concatenate((pixels, alpha), 2))
    if hasattr(bpy.types.Scene, "cycles"):  # else the shape alone tells
        _write_sheltered(layout, position, normal, folder)


def _write_sheltered(layout: Layout, position: Array, normal: Array, folder: Path) -> None:
    """The maps that are baked; the raster's texels lie at `position` and face `normal` [N, 3]."""
    raster, covered = layout.raster, layout.raster.covered
    size = shrunk(raster.size)
    seen = shelter(layout.seen.parts, layout.seen.around, layout.uv, size)
    sheltered = np.stack((seen.ao, seen.edge, seen.sky), 2)
    sheltered = _filled(sheltered, seen.baked, raster, position)
    # No face sees more of the sky than the half space in front of it has.
    up = (1 + _at(raster.image(normal[:, 2:]), size)[..., 0]) / 2
    sheltered[..., 2] = np.minimum(sheltered[..., 2], np.where(_at(covered, size), up, 1))
    there = any_within(covered, size)
    beside = nearest_covered(there, reach=_MARGIN)
    for name, values in zip(("ao", "edge", "sky"), np.moveaxis(sheltered, 2, 0), strict=True):
        write_exr(folder / f"{name}.exr", _beyond(values[..., None], beside)[..., 0])


def with_margin(raster: Raster, pixels: Array) -> Array:
    """A map [H, W] of a raster, gone on beside its faces."""
    return _beyond(pixels[..., None], nearest_covered(raster.covered, reach=_MARGIN))[..., 0]


def shrunk(size: tuple[int, int]) -> tuple[int, int]:
    """The size of what is baked for a map of this one."""
    share = min(1.0, _BAKED / np.sqrt(size[0] * size[1]))
    return max(round(size[0] * share), 1), max(round(size[1] * share), 1)


def _beyond(pixels: Array, nearest: NDArray[np.int64]) -> Array:
    """A map [H, W, C] that shows at each texel that which is `nearest`, and 0 where that is -1."""
    flat = pixels.reshape(-1, pixels.shape[2])
    return np.where(nearest[..., None] >= 0, flat[nearest], np.float32(0))


def _at(pixels: NDArray[np.generic], size: tuple[int, int]) -> NDArray:
    """What a map [H, W, ...] shows at the centers of texels of another size."""
    rows, columns = (
        ((np.arange(new) + 0.5) * old / new).astype(int)
        for new, old in zip(size, pixels.shape, strict=False)
    )
    return pixels[rows[:, None], columns]


def _filled(values: Array, baked: Marks, raster: Raster, position: Array) -> Array:
    """What was baked [H, W, C], and where faces are smaller than a texel, or touch but its border,
    what lies next to them on the surface.
    """
    nearest = nearest_covered(baked, reach=1)
    values = _beyond(values, nearest)
    height, width = baked.shape
    rows, columns = np.divmod(raster.texels, raster.size[1])
    here = rows * height // raster.size[0] * width + columns * width // raster.size[1]
    lost = (nearest < 0).reshape(-1)[here]
    if not lost.any() or not baked.any():
        return values
    there = baked.reshape(-1)[here]
    known, first = np.unique(here[there], return_index=True)
    tree = mathutils.kdtree.KDTree(len(known))
    for index, place in enumerate(position[there][first].tolist()):
        tree.insert(place, index)
    tree.balance()
    flat = values.reshape(-1, values.shape[2])
    texels, first = np.unique(here[lost], return_index=True)
    for texel, place in zip(texels.tolist(), position[lost][first].tolist(), strict=True):
        _, index, _ = tree.find(place)
        flat[texel] = flat[known[index]]
    return values
