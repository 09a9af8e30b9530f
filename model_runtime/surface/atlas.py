"""What a texture knows of the surface that it covers: where each texel lies, and how it is there.

Maps are asked for at any size. Between the texels of what was baked a place follows from the
nearest baked texel and the slope of the surface there, so that nothing is mixed across islands.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..reading.coverage import nearest_covered
from ..resampling import any_within

__all__ = ("MOST_KEPT", "Atlas", "Places")

Array = NDArray[np.float32]

MOST_KEPT = 1 << 22
"""Texels of maps that are kept for the next run, at most."""

_BEYOND = 1.5  # texels that a place may lie from the baked texel that it follows from
_ANOTHER_ISLAND = 3.0  # times the step on the other side: a step of position to another island


@dataclass(frozen=True)
class Places:
    """Places on the surface that some texels of a map show.

    texel: number of each in the map, counted row by row, [n]
    baked: number of the baked texel that each follows from, [n]
    position: in meters, [n, 3]
    """

    texel: NDArray[np.int64]
    baked: NDArray[np.int64]
    position: Array


@dataclass(frozen=True, eq=False)
class Atlas:
    """Maps of a surface, [H, W] or [H, W, 3], as they were baked; none is ever changed.

    position: meters from `origin`; normal: unit; both 0 where nothing is covered
    covered: which texels a face shows, at least one of them
    features: what else is known of the texels, 0 to 1, by name: `crevices`, `edges`, `sky`, and
        `blocked`, what never ages
    """

    position: Array
    normal: Array
    covered: NDArray[np.bool_]
    origin: tuple[float, float, float]
    features: dict[str, Array] = field(default_factory=dict)

    @property
    def size(self) -> tuple[int, int]:
        return self.covered.shape[0], self.covered.shape[1]

    @cached_property
    def slopes(self) -> tuple[Array, Array]:
        """How the position changes from a texel to the next, down and across: [H, W, 3] each."""
        return self._slope(0), self._slope(1)

    @cached_property
    def area(self) -> Array:
        """Square meters that each texel shows; what lies in islands of a texel or two, the usual
        area: [H, W].
        """
        area = np.linalg.norm(np.cross(*self.slopes), axis=-1)
        known = self.covered & (area > 0)
        usual = float(np.median(area[known])) if known.any() else 1.0
        return np.where(known, area, usual * self.covered).astype(np.float32)

    @cached_property
    def spacing(self) -> float:
        """Meters from a baked texel to the next, as a root of the mean of their areas."""
        return float(np.sqrt(self.area[self.covered].mean(dtype=np.float64)))

    @cached_property
    def extent(self) -> float:
        """Meters: the longest side of the box around all."""
        inside = self.position[self.covered]
        return float((inside.max(0) - inside.min(0)).max())

    @cached_property
    def nearest(self) -> NDArray[np.int64]:
        """The number of the covered texel that is nearest to each, [H, W]."""
        return nearest_covered(self.covered)

    def _slope(self, axis: int) -> Array:
        step = np.zeros_like(self.position)
        here = [slice(None)] * 2
        before, after = list(here), list(here)
        before[axis], after[axis] = slice(None, -1), slice(1, None)
        both = self.covered[tuple(before)] & self.covered[tuple(after)]
        difference = self.position[tuple(after)] - self.position[tuple(before)]
        difference[~both] = 0
        length = np.linalg.norm(difference, axis=-1)
        forward, backward = step, step.copy()
        forward[tuple(before)], backward[tuple(after)] = difference, difference
        ahead = np.zeros(self.covered.shape, np.float32)
        behind = ahead.copy()
        ahead[tuple(before)], behind[tuple(after)] = length, length
        # A step that is much longer than the other leads elsewhere; one of no length is none.
        use_ahead = (ahead > 0) & ((behind == 0) | (ahead <= _ANOTHER_ISLAND * behind))
        use_behind = (behind > 0) & ((ahead == 0) | (behind <= _ANOTHER_ISLAND * ahead))
        forward *= use_ahead[..., None]
        forward += backward * use_behind[..., None]
        count = use_ahead.astype(np.float32) + use_behind
        return forward / np.maximum(count, 1)[..., None]

    def covered_at(self, size: tuple[int, int]) -> NDArray[np.bool_]:
        """Which texels of a map of `size` a face shows: those that any of it lies in, [H, W]."""
        return any_within(self.covered, size)

    def places(self, covered: NDArray[np.bool_], rows: range) -> Places:
        """The places that texels of these rows show, where they are `covered` [H, W]."""
        height, width = covered.shape
        old_height, old_width = self.size
        row, column = np.nonzero(covered[rows.start : rows.stop])
        row += rows.start
        y = (row + 0.5) * (old_height / height) - 0.5
        x = (column + 0.5) * (old_width / width) - 0.5
        near = np.rint(y).astype(np.int64).clip(0, old_height - 1) * old_width
        near += np.rint(x).astype(np.int64).clip(0, old_width - 1)
        baked = self.nearest.reshape(-1).take(near)
        down, across = (slope.reshape(-1, 3) for slope in self.slopes)
        position = self.position.reshape(-1, 3).take(baked, 0)
        for slope, offset in (
            (down, y - baked // old_width),
            (across, x - baked % old_width),
        ):
            step = offset.clip(-_BEYOND, _BEYOND).astype(np.float32)[:, None]
            if step.any():
                position += slope.take(baked, 0) * step
        return Places(row * width + column, baked, position)

    def beside(
        self, covered: NDArray[np.bool_], rows: range
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Numbers of the texels of these rows that are not `covered` [H, W], and of a covered one
        next to each.
        """
        height, width = covered.shape
        old_height, old_width = self.size
        row, column = np.nonzero(~covered[rows.start : rows.stop])
        row += rows.start
        near = (row * 2 + 1) * old_height // (2 * height) * old_width
        near += (column * 2 + 1) * old_width // (2 * width)
        old_row, old_column = np.divmod(self.nearest.reshape(-1).take(near), old_width)
        source = (old_row * 2 + 1) * height // (2 * old_height) * width
        source += (old_column * 2 + 1) * width // (2 * old_width)
        return row * width + column, source

    def spacing_at(self, size: tuple[int, int]) -> float:
        """Meters from a texel of a map of `size` to the next."""
        return self.spacing * float(np.sqrt(self.covered.size / (size[0] * size[1])))
