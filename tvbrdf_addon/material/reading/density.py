"""How many pixels of a picture fall on a texture: the arithmetic, without Blender."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ("pixels_across",)

Array = NDArray[np.float64]

# Where w is 0 a camera's clip space ends: left, right, bottom, top, near.
_PLANES = np.array(
    ((1, 0, 0, 1), (-1, 0, 0, 1), (0, 1, 0, 1), (0, -1, 0, 1), (0, 0, 1, 1)), np.float64
)
# The share of the picture of a material that may have more pixels than are said: stretched slivers,
# which almost every mesh has, would otherwise decide.
_SLIVERS = 0.01


def pixels_across(corners: Array, uv: Array, clip: Array, focal: float) -> float:
    """Pixels that lie on the length of a texture where a camera comes nearest to it; 0 if unseen.

    `corners` [T, 3, 3] are triangles in the world and `uv` [T, 3, 2] where the texture lies on
    them; `clip` [4, 4] leads from the world to clip space, and `focal` is the number of pixels that
    a length of 1 has at w = 1.  A triangle with texture stretch s (the larger singular value of
    d world / d uv) whose visible part comes as near as w has at most s focal / w, foreshortening
    and occlusion left aside.
    """
    stretch, area = _stretch(corners, uv)
    nearest = _nearest(corners, clip)
    seen = np.isfinite(nearest) & np.isfinite(stretch) & (area > 0)
    if not seen.any():
        return 0.0
    scale = focal / nearest[seen]
    pixels, weight = stretch[seen] * scale, area[seen] * scale**2
    order = np.argsort(-pixels)
    share = np.cumsum(weight[order]) / weight.sum()
    return float(pixels[order][np.searchsorted(share, _SLIVERS)])


def _stretch(corners: Array, uv: Array) -> tuple[Array, Array]:
    """The most world that a unit of texture is stretched over [T], and the world's area [T]."""
    world, texture = (np.diff(each, axis=1) for each in (corners, uv))  # [T, 2, 3], [T, 2, 2]
    turned = texture[:, 0, 0] * texture[:, 1, 1] - texture[:, 0, 1] * texture[:, 1, 0]
    (a, b), (c, d) = (texture[:, i].T for i in (0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (d[:, None] * world[:, 0] - b[:, None] * world[:, 1]) / turned[:, None]
        v = (a[:, None] * world[:, 1] - c[:, None] * world[:, 0]) / turned[:, None]
        e, f, g = (np.einsum("ti,ti->t", x, y) for x, y in ((u, u), (u, v), (v, v)))
        stretch = np.sqrt((e + g) / 2 + np.hypot((e - g) / 2, f))
    area = np.linalg.norm(np.cross(world[:, 0], world[:, 1]), axis=1) / 2
    return stretch, area


def _nearest(corners: Array, clip: Array) -> Array:
    """The least w of the part of each triangle that the camera sees [T]; infinite where none is."""
    points = np.concatenate((corners, np.ones((*corners.shape[:2], 1))), -1) @ clip.T
    inside = points @ _PLANES.T >= 0  # [T, 3, 5]
    nearest = np.where(inside.all((1, 2)), points[..., 3].min(1), np.inf)
    crossing = np.flatnonzero(inside.any(1).all(1) & ~inside.all((1, 2)))
    polygons = points[crossing]
    for plane in _PLANES:
        crossing, polygons = _cut(crossing, polygons, plane)
    nearest[crossing] = polygons[..., 3].min(1, initial=np.inf)
    return nearest


def _cut(rows: NDArray[np.intp], polygons: Array, plane: Array) -> tuple[NDArray[np.intp], Array]:
    """The polygons [P, V, 4] within a plane, one corner more each; what is outside is left out.

    Sutherland and Hodgman, 1974.  A polygon with fewer corners than room repeats its first.
    """
    following = np.roll(polygons, -1, axis=1)
    here, there = polygons @ plane, following @ plane
    inside = here >= 0
    crosses = inside != (there >= 0)
    at = np.divide(here, here - there, out=np.zeros_like(here), where=crosses)
    crossings = polygons + at[..., None] * (following - polygons)
    count, room = polygons.shape[:2]
    points = np.stack((polygons, crossings), 2).reshape(count, 2 * room, 4)
    kept = np.stack((inside, crosses), 2).reshape(count, 2 * room)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : room + 1]
    points = np.take_along_axis(points, order[..., None], 1)
    points = np.where(np.take_along_axis(kept, order, 1)[..., None], points, points[:, :1])
    left = kept.any(1)
    return rows[left], points[left]
