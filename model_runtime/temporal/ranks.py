"""Ranks of values that come in parts: which share of all of them is smaller."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .processes import Pace

__all__ = ("Ranking",)

Array = NDArray[np.float32]

_BINS = 1 << 14
_BAND = 1 << 14  # values worked on at a time: what they need stays in the cache


class Ranking:
    """The distribution of values from `low` to `high`, counted or weighted, in 16,384 bins."""

    def __init__(self, low: float, high: float) -> None:
        self._range = low, high
        edge = np.zeros(0, np.float32)
        self._edges = np.histogram_bin_edges(edge, _BINS, (low, high) if low < high else (0, 1))
        self._total = np.zeros(_BINS)

    def add(self, values: Array, weights: Array | None = None) -> None:
        self._total += np.histogram(values, _BINS, self._range, weights=weights)[0]

    def paced(self, values: Array, pace: Pace, *, alike: float, amount: float = 1.0) -> Array:
        """Each value replaced by the `pace` of its rank; by `alike` where no two differ.

        Where only an `amount` of all is to start, the pace is theirs, and the others never do: 1.
        """
        low, high = self._range
        if high <= low:
            return np.full_like(values, alike)
        shares = np.concatenate(([0.0], np.cumsum(self._total) / self._total.sum()))
        times = np.interp(shares / max(amount, 1e-9), *np.transpose(pace))
        if amount < 1:
            times[shares >= amount] = 1.0
        return _interp(values, self._edges, times)


def _interp(values: Array, edges: NDArray[np.float64], times: NDArray[np.float64]) -> Array:
    """What np.interp gives, to the bit, without its search: `edges` are evenly spaced."""
    slope = np.diff(times) / np.diff(edges)
    low, high = edges[0], edges[-1]
    result = np.empty_like(values, np.float32)
    given, found = values.ravel("K"), result.ravel("K")
    for start in range(0, values.size, _BAND):
        at = given[start : start + _BAND].astype(np.float64).clip(low, high)
        bin = ((at - low) * (len(slope) / (high - low))).astype(np.int64).clip(0, len(slope) - 1)
        bin += (at >= edges[bin + 1]) & (bin < len(slope) - 1)
        bin -= at < edges[bin]
        found[start : start + _BAND] = slope[bin] * (at - edges[bin]) + times[bin]
    return np.ascontiguousarray(result)
