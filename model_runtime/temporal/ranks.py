"""Ranks of values that come in parts: which share of all of them is smaller."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .processes import Pace

__all__ = ("Ranking",)

Array = NDArray[np.float32]

_BINS = 1 << 14


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
        return np.interp(values, self._edges, times).astype(np.float32)
