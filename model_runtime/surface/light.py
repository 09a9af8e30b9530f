"""The timing of what light ages: by the dose that falls on each texel, not by one clock for all.

Light counts by its product with time, weak or strong (Bunsen and Roscoe's law of reciprocity; of
colors that fade Saunders and Kirby 1996), so that half the light makes half the age.

It is laid on points of the surface and from these on texels, as growth is, so that it goes on
across seams of the unwrapping; at edges it breaks, as light does.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..reading.coverage import nearest_covered
from ..resampling import resize
from .atlas import Atlas, Places
from .exposure import BLOCKED, SOUGHT
from .graph import join
from .interpolation import Interpolation
from .points import POINTS, Points, sample
from .seams import Seen
from .timing import WHITE, SurfaceTiming, chunks

__all__ = ("lit_timing",)

Array = NDArray[np.float32]

_TEXELS_A_POINT = 2  # of the light, in the mean: noise is evened out, and shadows stay sharp
_MOST_POINTS = 4 * POINTS
_LEAST = np.float32(1e-3)  # rate: nothing is so dark that it never changes
_EDGE = 0.8  # cosine between normals, below which an edge lies between them
_SMOOTH = 0.99  # cosine, below which facets meet at a seam, each with a light of its own
_REACH = 1.5  # times as far as a texel of the light goes on, what it shows may lie from its middle
_DOUBT = np.float32(1e-6)  # weight of what may be another part's light
_WORKERS = 2


def lit_timing(
    atlas: Atlas,
    light: Array,
    size: tuple[int, int],
    *,
    amount: float = 1.0,
    marks: Mapping[str, Array] | None = None,
) -> SurfaceTiming:
    """The timing of a map of `size` of the surface that `atlas` shows, by the `light` [h, w], 0 or
    more, NaN where it is not known, of an image of any size that is laid out as the atlas: what has
    1 or more in the mean comes to the end of its history in the end.

    All start at once, but for what is blocked (`marks`, as in `surface_timing`; what is sought
    counts as lit) and what is darkest where only an `amount` of the surface, 0 to 1, ever starts.
    """
    marks = marks or {}
    none = np.zeros(atlas.size, np.float32)
    sought = marks.get(SOUGHT, none)
    blocked = marks.get(BLOCKED, atlas.features.get(BLOCKED, none)) >= WHITE
    fallen = _Fallen.of(atlas, light)
    dose = np.maximum(fallen.light, fallen.points.mean_of(sought))
    least = _quantile(dose, fallen.points.area, 1 - amount) if amount < 1 else -np.inf
    covered = atlas.covered_at(size)
    rate, onset = np.zeros((2, *size), np.float32)

    def lay(rows: range) -> None:
        places = atlas.places(covered, rows)
        dose = np.maximum(fallen.at(places), sought.reshape(-1).take(places.baked))
        never = blocked.reshape(-1).take(places.baked) | (dose < least)
        rate.reshape(-1)[places.texel] = dose.clip(_LEAST, 1)
        onset.reshape(-1)[places.texel] = never

    with ThreadPoolExecutor(_WORKERS) as workers:
        list(workers.map(lay, chunks(size)))
    seam_ratio = Seen.of(atlas, rate * (1 - onset), least=_SMOOTH).seam_ratio()
    for rows in chunks(size):
        beside, source = atlas.beside(covered, rows)
        for pixels in (onset, rate):
            pixels.reshape(-1)[beside] = pixels.reshape(-1).take(source)
    account = {
        "maps": ["light", "position", "normal"],
        "area": round(float(fallen.points.area.sum(dtype=np.float64)), 9),
        "light": round(float(np.average(fallen.light.clip(0, 1), weights=fallen.points.area)), 4),
    }
    return SurfaceTiming(onset, rate, seam_ratio, account)


@dataclass(frozen=True)
class _Fallen:
    """The light that falls on the `points` of a surface, [n]; and on the atlas' `texels` [H W],
    which face as `normal` [H W, 3], as an image has it, NaN where it has none that is theirs.
    """

    points: Points
    light: Array
    field: Interpolation
    texels: Array
    normal: Array

    @classmethod
    def of(cls, atlas: Atlas, light: Array) -> _Fallen:
        texels, trusted = _at_texels(atlas, light)
        trust = np.where(trusted, np.float32(1), _DOUBT)
        known = np.count_nonzero(np.isfinite(light))
        points = sample(atlas, min(-(-known // _TEXELS_A_POINT), _MOST_POINTS))
        graph = join(points, _EDGE)
        total, weight = points.mean_of(texels * trust), points.mean_of(trust)
        # Slivers of an island with no middle of a texel in them have what is beside them.
        doubtful = np.flatnonzero(weight < 2 * _DOUBT)
        near = graph.neighbor.take(doubtful, 1)
        fallen = total / weight
        fallen[doubtful] = total[near].sum(0) / weight[near].sum(0)
        field = Interpolation.of(points, graph, fallen[:, None])
        own = np.where(trusted, texels, np.nan).reshape(-1)
        return cls(points, fallen, field, own, atlas.normal.reshape(-1, 3))

    def at(self, places: Places) -> Array:
        """The light at each place, [n]: where an edge cuts the point for it, that of its texel."""
        point, own = self.points.at(places), self.texels.take(places.baked)
        normal = self.normal.take(places.baked, 0)
        cosine = np.einsum("ij,ij->i", normal, self.points.normal.take(point, 0))
        smooth = self.field.at(places.position, point)[0]
        return np.where((cosine < _EDGE) & np.isfinite(own), own, smooth)


def _at_texels(atlas: Atlas, light: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The light at the texels of an atlas, [H, W], and whether that is theirs: a texel of the
    `light` shows what lies in its middle, and texels beside that may be another island's.
    """
    known = np.isfinite(light)
    light = light.reshape(-1).take(nearest_covered(known))
    size = min(light.shape[0], atlas.size[0]), min(light.shape[1], atlas.size[1])
    light, known = resize(light, size), resize(known.astype(np.float32), size) == 1
    shown, middle = zip(*map(_places, atlas.size, size), strict=True)
    there = np.ix_(*shown)
    down, across = (np.linalg.norm(slope, axis=-1) for slope in atlas.slopes)
    reach = (atlas.size[0] / size[0] + 1) / 2 * down + (atlas.size[1] / size[1] + 1) / 2 * across
    apart = atlas.position - atlas.position[np.ix_(*middle)]
    near = np.linalg.norm(apart, axis=-1) <= _REACH * reach[np.ix_(*middle)]
    alike = np.einsum("ijk,ijk->ij", atlas.normal, atlas.normal[np.ix_(*middle)]) >= _EDGE
    return light[there], known[there] & near & alike


def _places(length: int, coarse: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Along an axis of so many texels, the one of `coarse` ones in which each lies, and which of
    its own lies in the middle of that: [length] each.
    """
    shown = (np.arange(length) * 2 + 1) * coarse // (2 * length)
    return shown, (shown * 2 + 1) * length // (2 * coarse)


def _quantile(values: Array, area: Array, share: float) -> float:
    """The value below which a `share` of the surface lies."""
    order = np.argsort(values)
    below = np.cumsum(area[order], dtype=np.float64)
    place = np.searchsorted(below, share * below[-1])
    return float(values[order[min(int(place), len(order) - 1)]])
