"""What a timing is like on the surface: whether it breaks where the surface was cut open to be
unwrapped, and how much of it has started by when.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .atlas import Atlas, Places
from .points import near_pairs

__all__ = ("Seen",)

Array = NDArray[np.float32]
Index = NDArray[np.int64]

_MOST_SIDE = 1024  # texels a side that are looked at
_TOUCHING = 2.2  # texels apart in space, at most: each center lies up to one from the border
_ELSEWHERE = 2  # texels apart on the map, more than
_ALIKE = -0.2  # cosine between normals, at least
_FEWEST = 16  # texels that make a mean


@dataclass(frozen=True)
class Seen:
    """A map by the texels of a grid over it that show anything: values [n] there."""

    grid: _Grid
    values: Array

    @classmethod
    def of(cls, atlas: Atlas, pixels: Array, *, least: float = _ALIKE) -> Seen:
        """Of a map [H, W]; from a cosine between normals below `least` on two places do not touch,
        but meet at an edge.
        """
        grid = _Grid.of(atlas, (pixels.shape[0], pixels.shape[1]), least)
        return cls(grid, pixels.reshape(-1).take(grid.texel))

    def share_below(self, levels: NDArray[np.float64]) -> list[float]:
        """The share of the surface whose values are below each of these rising levels."""
        area = self.grid.area.astype(np.float64)
        below = np.searchsorted(levels, self.values, "right")
        shares = np.cumsum(np.bincount(below, area, len(levels) + 1)[:-1]) / area.sum()
        return [round(share, 4) for share in shares.tolist()]

    def seam_ratio(self) -> float | None:
        """Mean step from texel to texel across seams, by that from the same texels inward, both for
        the same distance in space.

        Texels of two places of the map that touch in space and face alike make a seam; None where
        hardly any do, or where nothing changes.
        """
        seams = self.grid.seams
        if seams is None:
            return None
        across = self._step(seams.rim, seams.other) / seams.across
        inward = self._step(seams.rim, seams.inner) / seams.inward
        return round(across / inward, 3) if inward > 0 else None

    def _step(self, i: Index, j: Index) -> float:
        """All steps between these texels together."""
        return float(np.abs(self.values[i] - self.values[j]).sum(dtype=np.float64))


@dataclass(frozen=True)
class _Seams:
    """Texels at the rim of an island, those across the seam and those inward of them, by their
    places in the grid's; and all distances across and inward together, in meters.
    """

    rim: Index
    other: Index
    inner: Index
    across: float
    inward: float


@dataclass(frozen=True)
class _Grid:
    """At most 1024 texels a side of a map, of those that show anything: which of the map's they
    are, counted row by row, and the area in square meters of what each is baked from, [n] each; and
    where they meet across seams, None where hardly any do.
    """

    texel: Index
    area: Array
    seams: _Seams | None

    @staticmethod
    @lru_cache(maxsize=1)
    def of(atlas: Atlas, size: tuple[int, int], least: float) -> _Grid:
        """That of a map of `size`; the last is kept, as the surface is."""
        height, width = (
            min(known, given, _MOST_SIDE) for known, given in zip(atlas.size, size, strict=True)
        )
        rows = (np.arange(height) * 2 + 1) * size[0] // (2 * height)
        columns = (np.arange(width) * 2 + 1) * size[1] // (2 * width)
        grid = np.ix_(rows, columns)
        # Where these very texels lie, not the larger ones that a map of this size would have.
        looked_at = np.zeros(size, bool)
        looked_at[grid] = atlas.covered_at(size)[grid]
        places = atlas.places(looked_at, range(size[0]))
        row, column = np.divmod(places.texel, size[1])
        number = np.searchsorted(rows, row) * width + np.searchsorted(columns, column)
        area = atlas.area.reshape(-1).take(places.baked)
        found = _Look(atlas, looked_at[grid], replace(places, texel=number)).seams(least)
        return _Grid(places.texel, area, found)


@dataclass(frozen=True)
class _Look:
    """The places that the texels of a grid show, where it is `covered` [h, w]."""

    atlas: Atlas
    covered: NDArray[np.bool_]
    places: Places

    def seams(self, least: float) -> _Seams | None:
        shape = self.covered.shape[0], self.covered.shape[1]
        position, normal = np.zeros((2, self.covered.size, 3), np.float32)
        position[self.places.texel] = self.places.position
        normals = self.atlas.normal.reshape(-1, 3)
        normal[self.places.texel] = normals.take(self.places.baked, 0)
        reach = _TOUCHING * self.atlas.spacing_at(shape)
        rim, inner = self._rim(position, 1.5 * reach)
        i, j = near_pairs(position[rim], reach)
        i, inner, j = rim[i], inner[i], rim[j]
        apart = self._elsewhere(i, j, position, reach)
        apart &= np.einsum("ij,ij->i", normal[i], normal[j]) >= least
        i, inner, j = i[apart], inner[apart], j[apart]
        distance = np.linalg.norm(position[i] - position[j], axis=-1)
        order = np.lexsort((distance, i))
        nearest = order[np.unique(i[order], return_index=True)[1]]
        if len(nearest) < _FEWEST:
            return None
        i, inner, j = i[nearest], inner[nearest], j[nearest]

        def apart_in_all(others: Index) -> float:
            # A pair that coincides counts as one a twentieth of a texel apart.
            lengths = np.linalg.norm(position[i] - position[others], axis=-1)
            return float(np.maximum(lengths, reach / 40).sum(dtype=np.float64))

        place = np.zeros(self.covered.size, np.int64)
        place[self.places.texel] = np.arange(len(self.places.texel))
        return _Seams(place[i], place[j], place[inner], apart_in_all(j), apart_in_all(inner))

    def _elsewhere(self, i: Index, j: Index, position: Array, reach: float) -> NDArray[np.bool_]:
        """Whether the way from i to j on the map leads elsewhere, or only by texels that are small
        there: then the surface goes on as it does at i.
        """
        height, width = self.covered.shape
        baked = np.zeros(self.covered.size, np.int64)
        baked[self.places.texel] = self.places.baked
        (row, column), (other_row, other_column) = np.divmod(i, width), np.divmod(j, width)
        steps = other_row - row, other_column - column
        foretold = position[i]
        for slope, step, old, new in zip(
            self.atlas.slopes, steps, self.atlas.size, (height, width), strict=True
        ):
            whole = (step * (old / new)).astype(np.float32)
            foretold += slope.reshape(-1, 3).take(baked[i], 0) * whole[:, None]
        near = np.linalg.norm(position[j] - foretold, axis=-1) <= reach
        return ~near & (np.maximum(*map(np.abs, steps)) > _ELSEWHERE)

    def _rim(self, position: Array, reach: float) -> tuple[Index, Index]:
        """Numbers of texels at the rim of an island, and of the next one inward of each."""
        height, width = self.covered.shape
        position = position.reshape(height, width, 3)
        number = np.arange(height * width).reshape(height, width)
        rim, inner = [], []
        for axis, step in ((0, width), (1, 1)):
            length = np.linalg.norm(np.diff(position, axis=axis), axis=-1)
            pairs = [self.covered.take(range(k, k + length.shape[axis]), axis) for k in (0, 1)]
            joined = pairs[0] & pairs[1] & (length <= reach)
            ends = [(1, 0) if each == axis else (0, 0) for each in (0, 1)]
            before = np.pad(joined, ends)
            after = np.pad(joined, [end[::-1] for end in ends])
            for here, there, inward in ((before, after, -step), (after, before, step)):
                rim.append(number[here & ~there])
                inner.append(rim[-1] + inward)
        return np.concatenate(rim), np.concatenate(inner)
