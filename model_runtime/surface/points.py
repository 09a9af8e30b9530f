"""A few ten thousand points that stand for a surface, the same whatever the size of its maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .atlas import Atlas, Places

__all__ = ("POINTS", "Points", "near_pairs", "sample")

Array = NDArray[np.float32]
Index = NDArray[np.int64]

POINTS = 60_000
"""Points that a surface of usual shape is given, within a factor of about 1.5."""

_CELLS_A_POINT = 1.5  # cells of a grid that a surface passes through, for each of its squares
_STEPS = 2.0  # cell sizes to a doubling: those of a map and of its smaller copy are the same one
_MOST_CELLS = 1 << 20  # along an axis
_MOST_IN_A_CELL = 48  # that are looked at: what is heaped upon one place says nothing new
_TEXELS_A_CELL = 1.5
_NEARLY_ALL = 0.9
_PIECES = 2.0  # of a texel along a cell's side, at least
_MOST_PIECES = 16
# No common face of a mesh lies where two directions are equally near after this turn.
_TURN = np.linalg.qr(np.array([[0.9, 0.3, 0.2], [-0.35, 0.8, 0.4], [-0.1, -0.45, 0.85]]))[0]
_DIRECTIONS = 6


@dataclass(frozen=True, eq=False)
class Points:
    """Points [n] of a surface, sorted by `key`, and which of them stands for a place.

    key: of the grid's cell and the direction that the surface faces there
    position: meters from the atlas's origin, [n, 3]; normal [n, 3], unit; area in square meters
    spacing: meters, the side of a cell
    pieces: of texels, small enough to lie in a cell each: of which point and of which baked texel
        they are, and their area, [m] each
    """

    key: Index
    position: Array
    normal: Array
    area: Array
    spacing: float
    pieces: tuple[Index, Index, NDArray[np.float64]]
    _of_texel: NDArray[np.int32]
    _facing: NDArray[np.int8]

    def __len__(self) -> int:
        return len(self.key)

    def mean_of(self, pixels: Array) -> Array:
        """What each point's texels have on average in a map [H, W] of the atlas: [n]."""
        point, texel, area = self.pieces
        total = np.bincount(point, area * pixels.reshape(-1).take(texel), len(self))
        return (total / np.bincount(point, area, len(self))).astype(np.float32)

    def nearest(
        self, places: Sequence[tuple[float, float, float]], origin: tuple[float, float, float]
    ) -> Index:
        """The point that lies nearest to each place, in meters of the world, in which the atlas's
        `origin` lies there: [k].
        """
        apart = [self.position - np.subtract(each, origin).astype(np.float32) for each in places]
        return np.array([np.square(each).sum(-1).argmin() for each in apart], np.int64)

    def at(self, places: Places) -> NDArray[np.int32]:
        """The point that stands for each place, or for the baked texel that it follows from."""
        facing = self._facing.take(places.baked)
        key = _cell_keys(_cells(places.position, self.spacing)) * _DIRECTIONS + facing
        point = np.searchsorted(self.key, key).astype(np.int32)
        point[point == len(self.key)] = 0
        return np.where(self.key[point] == key, point, self._of_texel.take(places.baked))


@lru_cache(maxsize=1)
def sample(atlas: Atlas, count: int = POINTS) -> Points:
    """Points of a surface by a grid in space: of a cell and a direction faced, the mean.

    Two sides of a sheet, however thin, are faced in two directions. The last surface's are kept, as
    `read_surface` keeps it.
    """
    total = atlas.area.sum(dtype=np.float64)
    wanted = round(np.log2(max(np.sqrt(_CELLS_A_POINT * total / count), 1e-9)) * _STEPS)
    # Islands lie up to two texels apart, as texels whose centers miss a face are not covered.
    least = max(_TEXELS_A_CELL * _usual_side(atlas), 2 * atlas.extent / _MOST_CELLS, 1e-9)
    size = float(2.0 ** (max(wanted, np.ceil(np.log2(least) * _STEPS)) / _STEPS))
    texel, position, area = _pieces(atlas, size)
    normal = atlas.normal.reshape(-1, 3)
    facing = np.full(atlas.covered.size, -1, np.int8)
    covered = np.flatnonzero(atlas.covered)
    facing[covered] = _facing(normal[covered])
    key, point = np.unique(
        _cell_keys(_cells(position, size)) * _DIRECTIONS + facing[texel], return_inverse=True
    )
    weight = np.bincount(point, area)

    def mean(vectors: Array) -> Array:
        sums = [np.bincount(point, area * vectors[:, axis]) for axis in range(3)]
        return (np.stack(sums, -1) / weight[:, None]).astype(np.float32)

    faced = mean(normal[texel])
    faced /= np.maximum(np.linalg.norm(faced, axis=-1, keepdims=True), 1e-6)
    of_texel = np.full(atlas.covered.size, -1, np.int32)
    of_texel[texel] = point
    pieces = point, texel, area
    return Points(
        key, mean(position), faced, weight.astype(np.float32), size, pieces, of_texel, facing
    )


def _usual_side(atlas: Atlas) -> float:
    """Meters: what the longer side of the texels of nearly all of the surface does not exceed."""
    side = np.maximum(*(np.linalg.norm(slope[atlas.covered], axis=-1) for slope in atlas.slopes))
    order = np.argsort(side)
    share = np.cumsum(atlas.area[atlas.covered][order], dtype=np.float64)
    return float(np.interp(_NEARLY_ALL * share[-1], share, side[order]))


def _pieces(atlas: Atlas, size: float) -> tuple[Index, Array, NDArray[np.float64]]:
    """Of which baked texel each piece is, where it lies and its area; large texels are cut."""
    covered = np.flatnonzero(atlas.covered)
    slopes = [slope.reshape(-1, 3)[covered] for slope in atlas.slopes]
    longest = np.maximum(*(np.linalg.norm(slope, axis=-1) for slope in slopes))
    sides = np.ceil(_PIECES * longest / size).clip(1, _MOST_PIECES).astype(np.int64)
    which = np.repeat(np.arange(len(covered)), sides**2)
    place = np.arange(len(which)) - np.repeat(np.cumsum(sides**2) - sides**2, sides**2)
    position = atlas.position.reshape(-1, 3)[covered][which]
    cut = np.flatnonzero(sides[which] > 1)
    many = sides[which[cut]]
    for slope, step in zip(slopes, np.divmod(place[cut], many), strict=True):
        share = ((step + 0.5) / many - 0.5).astype(np.float32)
        position[cut] += slope[which[cut]] * share[:, None]
    area = atlas.area.reshape(-1)[covered][which] / sides[which].astype(np.float64) ** 2
    return covered[which], position, area


def _facing(normal: Array) -> Index:
    """Which way each normal points, roughly: 0 to 5."""
    turned = np.stack([normal @ row for row in _TURN.astype(np.float32)])
    axis = np.abs(turned).argmax(0)
    return axis * 2 + (np.take_along_axis(turned, axis[None], 0)[0] < 0)


def _cells(position: Array, size: float) -> Index:
    return np.floor(position * np.float32(1 / size)).astype(np.int64)


def _cell_keys(cell: Index) -> Index:
    shifted = cell + _MOST_CELLS // 2
    return (shifted[:, 0] * _MOST_CELLS + shifted[:, 1]) * _MOST_CELLS + shifted[:, 2]


def near_pairs(position: Array, reach: float) -> tuple[Index, Index]:
    """Ordered pairs (i, j), i != j, of positions [n, 3] at most `reach` from each other: all of
    them, but for places where dozens crowd.
    """
    key = _cell_keys(_cells(position, reach))
    order = np.argsort(key, kind="stable")
    occupied, start = np.unique(key[order], return_index=True)
    count = np.diff(np.append(start, len(order)))
    first: list[Index] = []
    second: list[Index] = []
    steps = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    for step in steps @ np.array([_MOST_CELLS**2, _MOST_CELLS, 1]):
        place = np.searchsorted(occupied, key + step)
        place[place == len(occupied)] = 0
        here = np.flatnonzero(occupied[place] == key + step)
        place = place[here]
        for slot in range(min(int(count[place].max(initial=0)), _MOST_IN_A_CELL)):
            more = count[place] > slot
            here, place = here[more], place[more]
            other = order[start[place] + slot]
            apart = position[other] - position[here]
            near = (np.einsum("ij,ij->i", apart, apart) <= reach * reach) & (other != here)
            first.append(here[near])
            second.append(other[near])
    return np.concatenate(first), np.concatenate(second)
