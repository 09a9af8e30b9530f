"""What a timing is like on the surface: whether it breaks where the surface was cut open to be
unwrapped, and how much of it has started by when.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

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
    """A map [H, W] by the places that it shows, on a grid of at most 1024 texels a side.

    covered, values: of the grid, [h, w]
    """

    atlas: Atlas
    covered: NDArray[np.bool_]
    places: Places
    values: Array

    @classmethod
    def of(cls, atlas: Atlas, pixels: Array) -> Seen:
        height, width = (
            min(known, given, _MOST_SIDE)
            for known, given in zip(atlas.size, pixels.shape, strict=True)
        )
        rows = (np.arange(height) * 2 + 1) * pixels.shape[0] // (2 * height)
        columns = (np.arange(width) * 2 + 1) * pixels.shape[1] // (2 * width)
        grid = np.ix_(rows, columns)
        # Where these very texels lie, not the larger ones that a map of this size would have.
        looked_at = np.zeros(pixels.shape, bool)
        looked_at[grid] = atlas.covered_at((pixels.shape[0], pixels.shape[1]))[grid]
        places = atlas.places(looked_at, range(pixels.shape[0]))
        row, column = np.divmod(places.texel, pixels.shape[1])
        number = np.searchsorted(rows, row) * width + np.searchsorted(columns, column)
        return cls(atlas, looked_at[grid], replace(places, texel=number), pixels[grid])

    def share_below(self, levels: NDArray[np.float64]) -> list[float]:
        """The share of the surface whose values are below each of these rising levels."""
        area = self.atlas.area.reshape(-1).take(self.places.baked).astype(np.float64)
        values = self.values.reshape(-1).take(self.places.texel)
        below = np.searchsorted(levels, values, "right")
        shares = np.cumsum(np.bincount(below, area, len(levels) + 1)[:-1]) / area.sum()
        return [round(share, 4) for share in shares.tolist()]

    def seam_ratio(self) -> float | None:
        """Mean step from texel to texel across seams, by that from the same texels inward, both for
        the same distance in space.

        Texels of two places of the map that touch in space and face alike make a seam; None where
        hardly any do, or where nothing changes.
        """
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
        apart &= np.einsum("ij,ij->i", normal[i], normal[j]) >= _ALIKE
        i, inner, j = i[apart], inner[apart], j[apart]
        distance = np.linalg.norm(position[i] - position[j], axis=-1)
        order = np.lexsort((distance, i))
        nearest = order[np.unique(i[order], return_index=True)[1]]
        if len(nearest) < _FEWEST:
            return None
        i, inner, j = i[nearest], inner[nearest], j[nearest]
        # A pair that coincides counts as one a twentieth of a texel apart.
        across = self._slope(i, j, position, reach / 40)
        inward = self._slope(i, inner, position, reach / 40)
        return round(across / inward, 3) if inward > 0 else None

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

    def _slope(self, i: Index, j: Index, position: Array, least: float) -> float:
        """The mean step between texels, by their mean distance."""
        values = self.values.reshape(-1)
        step = np.abs(values[i] - values[j]).sum(dtype=np.float64)
        distance = np.linalg.norm(position[i] - position[j], axis=-1)
        return float(step / np.maximum(distance, least).sum(dtype=np.float64))

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
