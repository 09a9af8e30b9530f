"""A layout in which no two faces lie on one another: projected along the axes, packed in rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .raster import rasterize
from .shells import components, neighbors

__all__ = ("Faces", "laid_out")

Array = NDArray[np.float32]
Numbers = NDArray[np.int64]

# Texels between charts, the fewer the more of them there are.
_GAPS = (4, 2, 1)
# How often what overlaps itself is halved before each of its faces stands alone.
_HALVINGS = 5
_LOOKED_AT = 512  # texels a side
# Of a chart's texels, how many may show two of its faces: those that borders cut.
_CUT = 0.01


@dataclass(frozen=True)
class Faces:
    """Triangles [T, 3, 3] in the world's units with the numbers of their `vertices` [T, 3] and of
    their `polygons` [T], whose triangles stay together.
    """

    corners: Array
    vertices: Numbers
    polygons: Numbers


def laid_out(meshes: Sequence[Faces], size: int) -> list[Array] | None:
    """Where the triangles of all meshes lie in one square of `size` texels: [T, 3, 2] each.

    All have the same number of texels a unit of length, but no face has none.  None where there are
    more faces than the square has room for.
    """
    whole = _joined(meshes)
    axis, flat, depth = _projected(whole)
    pairs, _ = neighbors(whole.vertices)
    group = axis.astype(np.int64)  # faces of a group may share a chart
    for attempt in range(_HALVINGS + 2):
        charts = _charts(whole, pairs, group)
        uv = _packed(flat, charts, size)
        if uv is None:
            return None
        overlapping = _overlapping(uv, charts)[charts]
        if not overlapping.any():
            break
        if attempt < _HALVINGS:
            upper = depth > _middle(depth, charts)[charts]
            group = np.where(overlapping, 2 * group + upper, 2 * group)
        else:
            group = np.where(overlapping, group.max() + 1 + whole.polygons, group)
    ends = np.cumsum([len(mesh.corners) for mesh in meshes])
    return np.split(uv, ends[:-1])


def _joined(meshes: Sequence[Faces]) -> Faces:
    """All in one, with numbers of their own."""
    vertices, polygons, v, p = [], [], 0, 0
    for mesh in meshes:
        vertices.append(mesh.vertices + v)
        polygons.append(mesh.polygons + p)
        v = int(vertices[-1].max(initial=v)) + 1
        p = int(polygons[-1].max(initial=p)) + 1
    corners = np.concatenate([mesh.corners for mesh in meshes])
    return Faces(corners, np.concatenate(vertices), np.concatenate(polygons))


def _projected(faces: Faces) -> tuple[Numbers, Array, NDArray[np.float64]]:
    """The axis that each triangle's polygon faces (0 to 5), its corners [T, 3, 2] seen along it,
    and how far along it the polygon lies.
    """
    a, b, c = np.moveaxis(faces.corners.astype(np.float64), 1, 0)
    double = np.cross(b - a, c - a)
    normal = np.stack([_by(faces.polygons, double[:, k]) for k in range(3)], 1)
    axis = np.abs(normal).argmax(1)
    every = np.arange(len(axis))
    negative = normal[every, axis] < 0
    u, v = (axis + 1) % 3, (axis + 2) % 3
    corners = np.stack([faces.corners[every, :, each] for each in (u, v)], 2)
    corners[negative, :, 0] *= -1
    depth = _by(faces.polygons, faces.corners[every, :, axis].mean(1))
    return axis + 3 * negative, corners, depth / _by(faces.polygons, np.ones(len(axis)))


def _by(polygons: Numbers, values: NDArray[np.generic]) -> NDArray[np.float64]:
    return np.bincount(polygons, values).astype(np.float64)[polygons]


def _charts(faces: Faces, pairs: Numbers, group: Numbers) -> Numbers:
    """The chart of each triangle, numbered from 0: what of a group hangs together."""
    joined = pairs[group[pairs[:, 0]] == group[pairs[:, 1]]]
    order = np.argsort(faces.polygons, kind="stable")
    same = faces.polygons[order[1:]] == faces.polygons[order[:-1]]
    of_polygons = np.stack((order[:-1], order[1:]), 1)[same]
    labels = components(len(group), np.concatenate((joined, of_polygons)))
    return np.unique(labels, return_inverse=True)[1].reshape(-1)


def _packed(flat: Array, charts: Numbers, size: int) -> Array | None:
    """The corners [T, 3, 2] with their charts side by side in the square from 0 to 1."""
    count = int(charts.max()) + 1
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, charts, flat.min(1))
    np.maximum.at(high, charts, flat.max(1))
    lying = (high - low)[:, 0] >= (high - low)[:, 1]
    spans = np.where(lying[:, None], high - low, (high - low)[:, ::-1])
    found = _places(spans, size)
    if found is None:
        return None
    places, scale = found
    from_low = flat - low[charts, None]
    turned = np.where(lying[charts, None, None], from_low, from_low[..., ::-1])
    return ((turned * scale + places[charts, None]) / size).astype(np.float32)


def _places(spans: NDArray[np.float64], size: int) -> tuple[NDArray[np.float64], float] | None:
    """Where rectangles of these `spans` [C, 2] lie, in texels, and how many a unit has."""
    for gap in _GAPS:
        if _rows(np.zeros_like(spans), gap, size) is None:
            continue
        low, high = 0.0, size / max(float(spans.max()), 1e-30)
        for _ in range(24):
            middle = (low + high) / 2
            fits = _rows(spans * middle, gap, size) is not None
            low, high = (middle, high) if fits else (low, middle)
        places = _rows(spans * low, gap, size)
        assert places is not None
        return places, low
    return None


def _rows(spans: NDArray[np.float64], gap: int, size: int) -> NDArray[np.float64] | None:
    """The corners of rectangles set in rows, the highest first; None if they do not fit."""
    cells = np.maximum(np.ceil(spans - 1e-6), 1) + gap
    order = np.argsort(-cells[:, 1], kind="stable")
    if cells[:, 0].max() > size:
        return None
    ends = np.cumsum(cells[order, 0])
    places = np.empty_like(spans)
    first, top = 0, 0.0
    while first < len(order):
        before = ends[first - 1] if first else 0.0
        last = max(int(np.searchsorted(ends, before + size, side="right")), first + 1)
        row = order[first:last]
        places[row, 0] = ends[first:last] - cells[row, 0] - before
        places[row, 1] = top
        top += cells[order[first], 1]
        if top > size:
            return None
        first = last
    return places + gap // 2


def _overlapping(uv: Array, charts: Numbers) -> NDArray[np.bool_]:
    """Which charts lie on themselves: [C]."""
    raster = rasterize(uv, (_LOOKED_AT, _LOOKED_AT))
    count = int(charts.max()) + 1
    shown = charts[raster.triangles]
    texels = np.bincount(shown[raster.centers], minlength=count)
    shared = np.bincount(shown[raster.shared], minlength=count)
    return shared > _CUT * texels


def _middle(depth: NDArray[np.float64], charts: Numbers) -> NDArray[np.float64]:
    """Half way between the lowest and the highest of each chart: [C]."""
    count = int(charts.max()) + 1
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, charts, depth)
    np.maximum.at(high, charts, depth)
    return (low + high) / 2
