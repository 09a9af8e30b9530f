"""The folder of mesh maps that the worker grows ageing on, kept as long as the meshes stay."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import dataclass
from pathlib import Path

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ..reading.pixels import write_exr
from ..reading.tiles import Tiles
from .collect import UVMap
from .layout import Layout, lay_out
from .raster import Raster, nearest_within
from .shelter import shelter

__all__ = ("SurfaceMaps", "write_surface")

Array = NDArray[np.float32]
Marks = NDArray[np.bool_]

# Texels a side: of positions and normals, and at most of what is baked.
_SIZE, _BAKED = 1024, 384
# How far what is next to faces goes on, in texels.
_MARGIN = 16
# Folders that are kept, each of about 40 MB.
_KEPT = 4
_VERSION = b"1"  # of what is written


@dataclass(frozen=True)
class SurfaceMaps:
    """The `folder` of the maps, None where there are none, and what is to be said, in sentences.

    `own` is the UV map that they are laid out in, which the meshes do not have yet; None where it
    is the material's.
    """

    folder: Path | None
    own: UVMap | None
    notes: tuple[str, ...]


def write_surface(
    material: bpy.types.Material,
    scene: bpy.types.Scene,
    frame: int,
    *,
    uv_map: str | None,
    tiles: Tiles,
    kept: Path,
    size: int = _SIZE,
) -> SurfaceMaps:
    """Writes `position.exr` (world, meters; alpha 1 where a face is), `normal.exr` (world, unit),
    `ao.exr`, `edge.exr` and `sky.exr` (0 to 1) of all faces that show the material at `frame`.

    `uv_map` and `tiles` say where the material's own maps lie, as in `lay_out`.  Folders lie in
    `kept`, the last few of which stay for the next time.  Raises `MaterialError`.
    """
    layout = lay_out(material, scene, frame, uv_map=uv_map, tiles=tiles, size=size)
    if not isinstance(layout, Layout):
        return SurfaceMaps(None, None, layout)
    folder = kept / _digest(layout)
    if not folder.is_dir():
        part = folder.with_suffix(".part")
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        _write(layout, part)
        part.rename(folder)
    folder.touch()
    for old in sorted(kept.iterdir(), key=lambda each: each.stat().st_mtime)[:-_KEPT]:
        if old != folder:
            shutil.rmtree(old, ignore_errors=True)
    return SurfaceMaps(folder, layout.own, layout.notes)


def _digest(layout: Layout) -> str:
    """Of all that the maps are made from."""
    digest = hashlib.blake2b(_VERSION + repr(layout.raster.size).encode(), digest_size=16)
    digest.update(layout.uv.tobytes())
    for part in layout.seen.parts:
        digest.update(part.faces.corners.tobytes())
        digest.update(part.normals.tobytes())
    for around in layout.seen.around:
        digest.update(around.vertices.tobytes())
        digest.update(around.triangles.tobytes())
        digest.update(np.array(around.matrices, np.float64).tobytes())
    return digest.hexdigest()


def _write(layout: Layout, folder: Path) -> None:
    parts, raster = layout.seen.parts, layout.raster
    corners = np.concatenate([part.faces.corners for part in parts])
    position = raster.values(corners)
    normal = raster.values(np.concatenate([part.normals for part in parts]))
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    covered = raster.covered
    beside = nearest_within(covered, _MARGIN)
    alpha = covered.astype(np.float32)[..., None]
    for name, values in (("position", position), ("normal", normal)):
        pixels = _beyond(raster.image(values), beside)
        write_exr(folder / f"{name}.exr", np.concatenate((pixels, alpha), 2))
    size = _shrunk(raster.size)
    seen = shelter(parts, layout.seen.around, layout.uv, size)
    sheltered = np.stack((seen.ao, seen.edge, seen.sky), 2)
    sheltered = _filled(sheltered, seen.baked, raster, position)
    # No face sees more of the sky than the half space in front of it has.
    up = (1 + _at(raster.image(normal[:, 2:]), size)[..., 0]) / 2
    sheltered[..., 2] = np.minimum(sheltered[..., 2], np.where(_at(covered, size), up, 1))
    there = _at_any(covered, size)
    beside = nearest_within(there, _MARGIN)
    for name, values in zip(("ao", "edge", "sky"), np.moveaxis(sheltered, 2, 0), strict=True):
        write_exr(folder / f"{name}.exr", _beyond(values[..., None], beside)[..., 0])


def _shrunk(size: tuple[int, int]) -> tuple[int, int]:
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


def _at_any(covered: Marks, size: tuple[int, int]) -> Marks:
    """Which texels of another size have anything covered [H, W] in them."""
    there = np.zeros(size, bool)
    rows, columns = np.nonzero(covered)
    there[rows * size[0] // covered.shape[0], columns * size[1] // covered.shape[1]] = True
    return there


def _filled(values: Array, baked: Marks, raster: Raster, position: Array) -> Array:
    """What was baked [H, W, C], and where faces are smaller than a texel, or touch but its border,
    what lies next to them on the surface.
    """
    values = _beyond(values, nearest_within(baked, 1))
    height, width = baked.shape
    rows, columns = np.divmod(raster.texels, raster.size[1])
    here = rows * height // raster.size[0] * width + columns * width // raster.size[1]
    lost = (nearest_within(baked, 1) < 0).reshape(-1)[here]
    if not lost.any() or not baked.any():
        return values
    there = np.flatnonzero(baked.reshape(-1)[here])
    tree = mathutils.kdtree.KDTree(len(there))
    for index, place in enumerate(position[there].tolist()):
        tree.insert(place, index)
    tree.balance()
    flat = values.reshape(-1, values.shape[2])
    texels, first = np.unique(here[lost], return_index=True)
    for texel, place in zip(texels.tolist(), position[lost][first].tolist(), strict=True):
        _, index, _ = tree.find(place)
        flat[texel] = flat[here[there[index]]]
    return values
