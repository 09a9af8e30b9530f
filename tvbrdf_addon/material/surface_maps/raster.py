"""Triangles laid out in a square, as texels: which covers which, and where.  Plain numpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ("Raster", "rasterize")

Array = NDArray[np.float32]
Double = NDArray[np.float64]
Numbers = NDArray[np.int64]

# Of a texel: what a triangle has to reach into one to touch it; less is rounding.
_TOUCH = 1e-3
# Of a triangle's heights: a center nearer to a side than this lies on a border that two share.
_ON_BORDER = 1e-3


@dataclass(frozen=True)
class Raster:
    """What each texel of a map of `size` (height, width) shows, for those that a triangle touches.

    `texels` [N] count row by row, row 0 at the top; `triangles` [N] are those that they show, at
    `weights` [N, 3] of the corners: at the texel's center, or for one whose center lies beside all
    triangles where the nearest part of one is.  `centers` [N] tells these apart, and `shared` [N]
    the texels whose center lies in several triangles.
    """

    size: tuple[int, int]
    texels: Numbers
    triangles: Numbers
    weights: Double
    centers: NDArray[np.bool_]
    shared: NDArray[np.bool_]

    def values(self, corners: Array) -> Array:
        """What lies at the corners of all triangles [T, 3, C], at each texel touched: [N, C]."""
        return np.einsum("nk,nkc->nc", self.weights, corners[self.triangles]).astype(np.float32)

    def image(self, values: Array, beside: float = 0.0) -> Array:
        """Values of the texels touched [N, C] as a map [H, W, C], others showing `beside`."""
        pixels = np.full((self.size[0] * self.size[1], values.shape[1]), beside, np.float32)
        pixels[self.texels] = values
        return pixels.reshape(*self.size, -1)

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Which texels are touched: [H, W]."""
        covered = np.zeros(self.size[0] * self.size[1], bool)
        covered[self.texels] = True
        return covered.reshape(self.size)


def rasterize(uv: Array, size: tuple[int, int]) -> Raster:
    """Triangles [T, 3, 2] of the square from 0 to 1, seen by a map of `size` (height, width).

    A texel that several touch shows the one with its center, the first of these, or else the
    nearest.  No texel that a triangle touches is left out, however small the triangle is.
    """
    height, width = size
    corners = uv.astype(np.float64) * (width, -height) + (0, height)  # in texels, y down
    triangles, x, y = _touched(corners, size)
    weights = _barycentric(corners, triangles, x + 0.5, y + 0.5)
    depth = np.minimum(np.minimum(weights[0], weights[1]), weights[2])
    centers = depth >= -1e-9
    texels = y * width + x
    inner = np.bincount(texels[depth > _ON_BORDER], minlength=height * width)
    inside, beside = np.flatnonzero(centers := depth >= -1e-9), np.flatnonzero(~centers)
    # The last that is written to a place stays: the nearest, and of those inside the first.
    last = np.full(height * width, -1, np.int64)
    last[texels[inside[::-1]]] = inside[::-1]
    beside = beside[last[texels[beside]] < 0]
    beside = beside[np.argsort(depth[beside], kind="stable")]
    last[texels[beside]] = beside
    chosen = last[last >= 0]
    weights = np.stack([weight[chosen] for weight in weights], 1).clip(0)
    weights /= weights.sum(1, keepdims=True)
    return Raster(
        size, texels[chosen], triangles[chosen], weights, centers[chosen], inner[texels[chosen]] > 1
    )


def _touched(corners: Double, size: tuple[int, int]) -> tuple[Numbers, Numbers, Numbers]:
    """All pairs of a triangle and a texel that it touches: numbers of triangles, columns, rows.

    A triangle and a row of texels have a convex part in common, which touches all texels between
    its ends.
    """
    height, width = size
    low, high = corners[..., 1].min(1), corners[..., 1].max(1)
    first, last = _between(low, high, height)
    seen = np.flatnonzero((high >= 0) & (low <= height))
    triangles, rows = _ranges(seen, first[seen], last[seen])
    left, right = np.full(len(rows), np.inf), np.full(len(rows), -np.inf)
    for k in range(3):
        start, end = corners[triangles, k], corners[triangles, (k + 1) % 3]
        along = end - start
        with np.errstate(divide="ignore", invalid="ignore"):
            crossings = [(rows + side - start[:, 1]) / along[:, 1] for side in (0, 1)]
        flat = along[:, 1] == 0
        enters = np.where(flat, 0, np.minimum(*crossings)).clip(0, 1)
        leaves = np.where(flat, 1, np.maximum(*crossings)).clip(0, 1)
        inside = np.minimum(start[:, 1], end[:, 1]) <= rows + 1 + _TOUCH
        inside &= np.maximum(start[:, 1], end[:, 1]) >= rows - _TOUCH
        for at in (enters, leaves):
            x = start[:, 0] + at * along[:, 0]
            left = np.where(inside, np.minimum(left, x), left)
            right = np.where(inside, np.maximum(right, x), right)
    first, last = _between(left, right, width)
    seen = np.flatnonzero((right >= 0) & (left <= width))
    pairs, columns = _ranges(seen, first[seen], last[seen])
    return triangles[pairs], columns, rows[pairs]


def _between(low: Double, high: Double, length: int) -> tuple[Numbers, Numbers]:
    """The first and the last of `length` cells that lie between two places."""
    first = np.floor(low.clip(0, length) + _TOUCH)
    last = np.maximum(np.ceil(high.clip(0, length) - _TOUCH) - 1, first)
    return first.clip(0, length - 1).astype(np.int64), last.clip(0, length - 1).astype(np.int64)


def _ranges(owners: Numbers, first: Numbers, last: Numbers) -> tuple[Numbers, Numbers]:
    """Each owner as often as it has numbers from its first to its last, and these numbers."""
    counts = last - first + 1
    starts = np.cumsum(counts) - counts
    offsets = np.arange(counts.sum()) - np.repeat(starts, counts)
    return np.repeat(owners, counts), np.repeat(first, counts) + offsets


def _barycentric(corners: Double, triangles: Numbers, x: Double, y: Double) -> list[Double]:
    """The weights [N] of each corner of triangles [T, 3, 2] at points; of a flat one, in which no
    point lies, those of its longest side.
    """
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    flat = np.abs(area) <= 1e-9 * np.maximum((ab**2).sum(1), (ac**2).sum(1))
    slopes = np.stack((ac[:, 1], -ac[:, 0], -ab[:, 1], ab[:, 0])) / np.where(flat, 1, area)
    x, y = x - a[triangles, 0], y - a[triangles, 1]
    second = slopes[0][triangles] * x + slopes[1][triangles] * y
    third = slopes[2][triangles] * x + slopes[3][triangles] * y
    weights = [1 - second - third, second, third]
    if (at := np.flatnonzero(flat[triangles])).size:
        sides = _on_longest_side(corners[triangles[at]], np.stack((x, y), 1)[at])
        for weight, values in zip(weights, sides.T, strict=True):
            weight[at] = values
    return weights


def _on_longest_side(corners: Double, from_first: Double) -> Double:
    """The weights [N, 3] of the nearest points on the sides of triangles [N, 3, 2]; a hair below,
    so that they count as beside.
    """
    sides = np.roll(corners, -1, 1) - corners
    lengths = (sides**2).sum(2)
    longest, every = lengths.argmax(1), np.arange(len(corners))
    start = from_first - (corners[every, longest] - corners[:, 0])
    share = (start * sides[every, longest]).sum(1) / np.maximum(lengths[every, longest], 1e-30)
    weights = np.zeros((len(corners), 3))
    weights[every, longest] = 1 - share.clip(0, 1)
    weights[every, (longest + 1) % 3] = share.clip(0, 1)
    return weights - 1e-6
