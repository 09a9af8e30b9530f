"""The timing of what light ages: by the dose that falls on each texel, not by one clock for all.

Light counts by its product with time, weak or strong (Bunsen and Roscoe's law of reciprocity; of
colors that fade Saunders and Kirby 1996), so that half the light makes half the age.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..resampling import resize
from .atlas import Atlas
from .exposure import BLOCKED, SOUGHT
from .timing import WHITE, SurfaceTiming

__all__ = ("lit_timing",)

Array = NDArray[np.float32]

_LEAST = np.float32(1e-3)  # rate: nothing is so dark that it never changes


def lit_timing(
    atlas: Atlas,
    light: Array,
    size: tuple[int, int],
    *,
    amount: float = 1.0,
    marks: Mapping[str, Array] | None = None,
) -> SurfaceTiming:
    """The timing of a map of `size` of the surface that `atlas` shows, by the `light` [H, W], 0 to
    1, that falls on its texels: what has all of it comes to the end of its history in the end.

    All start at once, but for what is blocked (`marks`, as in `surface_timing`; what is sought
    counts as lit) and what is darkest where only an `amount` of the surface, 0 to 1, ever starts.
    """
    marks = marks or {}
    none = np.zeros_like(light)
    dose = np.maximum(light, marks.get(SOUGHT, none))
    never = np.asarray(marks.get(BLOCKED, atlas.features.get(BLOCKED, none)) >= WHITE)
    if amount < 1:
        never = never | (dose < _quantile(dose, atlas.area, 1 - amount))
    rate, late = (
        resize(pixels.reshape(-1).take(atlas.nearest), size)
        for pixels in (dose, never.astype(np.float32))
    )
    rate, onset = rate.clip(_LEAST, 1), np.rint(late)
    account = {
        "maps": ["light", "position", "normal"],
        "area": round(float(atlas.area.sum(dtype=np.float64)), 9),
        "light": round(float(np.average(light, weights=atlas.area)), 4),
    }
    return SurfaceTiming(onset, rate, None, account)  # light breaks at edges, seams or not


def _quantile(values: Array, area: Array, share: float) -> float:
    """The value below which a `share` of the surface lies."""
    order = np.argsort(values, axis=None)
    below = np.cumsum(area.reshape(-1)[order], dtype=np.float64)
    place = np.searchsorted(below, share * below[-1])
    return float(values.reshape(-1)[order[min(int(place), len(order) - 1)]])
