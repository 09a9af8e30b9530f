"""Texels that no face shows: they count nowhere, and look like the nearest that one does."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..maps import Pixels
from ..resampling import resize

__all__ = ("Coverage", "nearest_covered")

_UNKNOWN, _BEYOND = -1, -2


@dataclass(frozen=True)
class Coverage:
    """Which texels a face covers, `texels` [H, W], at least one of them."""

    texels: NDArray[np.bool_]
    _nearest: dict[tuple[int, ...], NDArray[np.int64]] = field(default_factory=dict)

    def at(self, size: tuple[int, int]) -> NDArray[np.bool_]:
        """The same at another size; a texel is covered where any part of it is."""
        return resize(self.texels.astype(np.float32), size) > 0

    def filled(self, pixels: Pixels) -> Pixels:
        """A map [H, W] or [H, W, C] that shows the nearest covered texel where none is; one of a
        single texel as it is.
        """
        height, width = pixels.shape[:2]
        if (height, width) == (1, 1):
            return pixels
        if (height, width) not in self._nearest:
            self._nearest[height, width] = nearest_covered(self.at((height, width)))
        return pixels.reshape(-1, *pixels.shape[2:])[self._nearest[height, width]]


def nearest_covered(covered: NDArray[np.bool_], *, reach: int | None = None) -> NDArray[np.int64]:
    """For each texel of [H, W] the number, counted row by row, of the nearest that is covered, in
    steps across and down; -1 where none is, or none in `reach` of such steps.

    Grown from all of them at once, a step at a time.
    """
    height, width = covered.shape
    source = np.full((height + 2, width + 2), _BEYOND)
    inside = source[1:-1, 1:-1]
    inside[...] = np.where(covered, np.arange(covered.size).reshape(covered.shape), _UNKNOWN)
    flat, border = source.reshape(-1), np.flatnonzero(source >= 0)
    for _ in itertools.count() if reach is None else range(reach):
        if not len(border):
            break
        reached = []
        for step in (-(width + 2), width + 2, -1, 1):
            free = flat[border + step] == _UNKNOWN
            there = border[free] + step
            flat[there] = flat[border[free]]
            reached.append(there)
        border = np.concatenate(reached)
    return inside
