"""More of the like of an example: patches of it, blended on a grid of triangles.

Each vertex of the grid shows the example from a place of its own; within a triangle its three
vertices are blended, each the more the nearer it is. The example's values are Gaussian, so that a
sum of them, divided by the root of its squared weights, is distributed as they are (Heitz and
Neyret 2018, section 3); tables then give back the histogram. What is laid on a surface is a blend
of three such planes, of which each counts where the surface faces it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ("Example", "Lookup", "in_tile", "on_surface")

Array = NDArray[np.float32]
Halves = NDArray[np.float16]
Whole = NDArray[np.uint32]
Index = NDArray[np.int32]

GAUSSIAN = 4.0
"""Deviations that a tile's 0 and 255 stand for, and the ends of a table."""

_FINE = 4096  # steps of a table as it is looked up, without interpolation
_LARGEST_SIDE = 2048  # of an example made larger than it is: that of a map of 4,096, usually
_EDGES = 4  # of triangles along a tile's side: as large as may be, and still many to a tile
_PERIOD = 64  # vertices after which the grid in space repeats: sixteen tiles
_PLACES = 64  # along a tile's side, at which a vertex may look
_FACING = 6  # power of the normal's parts: how suddenly one plane gives way to another
_NEGLIGIBLE = 0.02  # weight of a plane that nobody sees
_BAND = 1 << 15  # texels worked on at a time: what they need stays in the cache
_WORKERS = 2


@dataclass(frozen=True)
class Example:
    """A tile as it is looked up: components [K, S, S], bytes for -4 to 4, with tables [K, 256]."""

    tile: NDArray[np.uint8]
    table: Array

    def seen(self, side: int) -> Lookup:
        """The tile at another `side`, as near or as far as that is.

        From afar texels show means of many, whose deviation is less; so of a component they show
        the mean over what is lost.
        """
        side = min(side, _LARGEST_SIDE)
        word = np.uint32 if len(self.tile) <= 4 else np.uint64
        packed, tables = np.zeros((side, side), word), []
        for component, (bytes_, table) in enumerate(zip(self.tile, self.table, strict=True)):
            gaussian = _resampled(bytes_ * (2 * GAUSSIAN / 255) - GAUSSIAN, side)
            deviation = min(max(float(gaussian.std()), 1e-6), 1.0)
            levels = np.rint((gaussian / deviation + GAUSSIAN) * (255 / (2 * GAUSSIAN)))
            packed |= levels.clip(0, 255).astype(word) << word(8 * component)
            tables.append(_mean_over_lost(table, deviation))
        return Lookup(packed.reshape(-1), side, np.stack(tables))


@dataclass(frozen=True)
class Lookup:
    """A tile of `side` texels [S S], a byte a component, and tables [K, 4096] of values at
    Gaussian -4 to 4.
    """

    texels: NDArray[np.unsignedinteger]
    side: int
    table: Array

    def blended(self, x: Whole, y: Whole, corners: list[tuple[Whole, Whole, Array]]) -> list[Array]:
        """Gaussian components [n] at texels `x`, `y` of the tile [n], seen from the three corners
        of a triangle: where each is moved to, [n] along x and y, and its weight [n].
        """
        side = np.uint32(self.side)
        sums = [np.zeros(x.shape, np.float32) for _ in self.table]
        square = np.zeros(x.shape, np.float32)
        word = self.texels.dtype.type
        for right, down, weight in corners:
            found = self.texels.take(_wrapped(y + down, side) * side + _wrapped(x + right, side))
            for component, total in enumerate(sums):
                level = (found >> word(8 * component)).astype(np.uint8).astype(np.float32)
                level -= 127.5
                level *= weight
                total += level
            square += weight * weight
        scale = np.float32(2 * GAUSSIAN / 255) / np.sqrt(square)
        for total in sums:
            total *= scale
        return sums

    def put(self, gaussian: list[Array], values: Halves) -> None:
        """The components' `values` [K, n] where they are `gaussian` [n]."""
        for level, table, value in zip(gaussian, self.table, values, strict=True):
            level += GAUSSIAN
            level *= (_FINE - 1) / (2 * GAUSSIAN)
            np.clip(level, 0, _FINE - 1, out=level)
            value[...] = table.take(np.rint(level, out=level).astype(np.int32))


def in_tile(example: Example, size: tuple[int, int], share: float, seed: int) -> Halves:
    """Components [K, H W] of a map of `size` that wraps, of whose longer side the example covers a
    `share`.
    """
    height, width = size
    longer = max(size)
    wanted = max(1, round(longer * share))  # so that a texel of the map is one of the example
    lookup = example.seen(wanted)
    texel = lookup.side / wanted
    x, y = (((np.arange(n) * texel).astype(np.uint32) % lookup.side) for n in (width, height))
    edge = share / _EDGES * longer
    columns = max(2, round(width / edge))
    rows = 2 * max(1, round(height / (edge * np.sqrt(3))))
    right, below = _wrapping_moves((rows, columns), size, lookup.side, texel, seed)
    across = ((np.arange(width) + 0.5) * (columns / width)).astype(np.float32)
    down = ((np.arange(height) + 0.5) * (rows / height)).astype(np.float32)
    values = np.empty((len(lookup.table), height * width), np.float16)

    def lay(part: range) -> None:
        some = slice(part.start, part.stop)
        corners = _corners(across[None, :], down[some, None])
        seen = [
            (right[row, column + rows // 2], below[row, column + rows // 2], weight)
            for row, column, weight in corners
        ]
        across_tile, down_tile = np.broadcast_arrays(x[None, :], y[some, None])
        gaussian = lookup.blended(across_tile, down_tile, seen)
        place = slice(part.start * width, part.stop * width)
        lookup.put([each.reshape(-1) for each in gaussian], values[:, place])

    _in_parallel(lay, height, max(1, _BAND // width))
    return values


def on_surface(
    example: Example, position: Array, normal: Array, side: float, seed: int, *, texel: float
) -> Halves:
    """Components [K, n] at positions [n, 3] with unit normals [n, 3], where the example's side has
    the length `side` and texels are `texel` apart.
    """
    lookup = example.seen(max(1, round(side / texel)))
    rng = np.random.default_rng((seed & (2**64 - 1), _PERIOD))
    moves = [_looks(rng, (_PERIOD, _PERIOD), lookup.side).astype(np.uint32) for _ in range(3)]
    values = np.empty((len(lookup.table), len(position)), np.float16)

    def lay(part: range) -> None:
        some = slice(part.start, part.stop)
        place = position[some].T / np.float32(side)
        facing = np.abs(normal[some].T) ** _FACING
        facing /= facing.sum(0).clip(1e-12)
        total = np.zeros((len(lookup.table), len(part)), np.float32)
        square = np.zeros(len(part), np.float32)
        # Each plane's second axis points down, as a map's does: z is up.
        for moved, weight, x, y in zip(
            moves, facing, (place[1], place[0], place[0]), (-place[2], -place[2], -place[1]),
            strict=True,
        ):  # fmt: skip
            rows = np.flatnonzero(weight > _NEGLIGIBLE)
            if len(rows) == 0:
                continue
            weight = weight.take(rows)
            gaussian = _on_plane(lookup, x.take(rows), y.take(rows), moved)
            for plane, component in zip(total, gaussian, strict=True):
                plane[rows] += weight * component
            square[rows] += weight * weight
        total /= np.sqrt(square.clip(1e-12))
        lookup.put([*total], values[:, some])

    _in_parallel(lay, len(position), _BAND)
    return values


def _on_plane(lookup: Lookup, x: Array, y: Array, moved: Whole) -> list[Array]:
    """Gaussian components [n] at places of a plane [n], in sides of the tile; `moved` [2, P, P]
    are the moves of its vertices, which repeat.
    """
    mask = _PERIOD - 1
    right, below = moved.reshape(2, -1)
    seen = []
    for row, column, weight in _corners(x * _EDGES, y * np.float32(_EDGES * 2 / np.sqrt(3))):
        vertex = ((row & mask) * _PERIOD) + (column & mask)
        seen.append((right.take(vertex), below.take(vertex), weight))
    return lookup.blended(_texel(x, lookup.side), _texel(y, lookup.side), seen)


def _texel(place: Array, side: int) -> Whole:
    """The texel of a tile of `side` at places in its sides."""
    texel = ((place - np.floor(place)) * side).astype(np.uint32)
    return np.minimum(texel, np.uint32(side - 1))  # just below 1 may be rounded up


def _corners(across: Array, down: Array) -> Iterator[tuple[Index, Index, Array]]:
    """The corners of the triangle that a place lies in: row, column and weight of each.

    Places are in edges across and rows down; each row's vertices lie half an edge to the right of
    those of the row above it.
    """
    row = np.floor(down)
    v = down - row
    skewed = across - down * np.float32(0.5)
    column = np.floor(skewed)
    u = skewed - column
    upper = u + v < 1
    i, j = column.astype(np.int32), row.astype(np.int32)
    w = np.abs(1 - u - v)
    one = (~upper).astype(np.int32)
    # Squared, so that most of a triangle shows one patch and not a haze of three.
    yield j + one, i + one, np.square(w)
    yield j + one, i + (1 - one), np.square(np.where(upper, u, 1 - u))
    yield j + (1 - one), i + one, np.square(np.where(upper, v, 1 - v))


def _wrapping_moves(
    grid: tuple[int, int], size: tuple[int, int], side: int, texel: float, seed: int
) -> tuple[Whole, Whole]:
    """By how much the vertices of a grid that wraps move a tile of `side` along x and y.

    Rows 0 to the last and again the first, columns from minus half the rows: a row further down
    begins further left. One vertex has one look wherever it lies in the map.
    """
    rows, columns = grid
    row = np.arange(rows + 1)[:, None]
    times_down, row = np.divmod(row, rows)
    column = np.arange(-(rows // 2), columns + 2)[None, :] + times_down * (rows // 2)
    times_across, column = np.divmod(column, columns)
    rng = np.random.default_rng((seed & (2**64 - 1), *grid))
    looks = _looks(rng, grid, side)[:, row, column]
    right, down = (
        ((look - np.rint(times * length * texel).astype(np.int64)) % side).astype(np.uint32)
        for look, times, length in zip(looks, (times_across, times_down), size[::-1], strict=True)
    )
    return right, down


def _looks(rng: np.random.Generator, grid: tuple[int, int], side: int) -> NDArray[np.int64]:
    """[2, *grid]: where each vertex looks at a tile of `side`, at one of so many places that a
    small tile has them where the large one has.
    """
    return rng.integers(0, _PLACES, (2, *grid)) * side // _PLACES


def _wrapped(place: Whole, side: np.uint32) -> Whole:
    """`place` modulo `side`, of which it is below twice: what is too small turns huge."""
    return np.minimum(place, place - side)


def _in_parallel(work: Callable[[range], None], count: int, step: int) -> None:
    parts = [range(start, min(start + step, count)) for start in range(0, count, step)]
    with ThreadPoolExecutor(_WORKERS) as workers:
        for _ in workers.map(work, parts):
            pass


def _resampled(values: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """[side, side] of [S, S] that wraps: waves too short for it are left out."""
    old = len(values)
    if side == old:
        return values
    kept = min(side, old)
    half = (kept - 1) // 2
    spectrum = np.fft.fft2(values)
    place = np.r_[0 : half + 1, -half:0]
    # Texels lie in the middle of what they cover.
    turn = np.exp(1j * np.pi * place * (1 / side - 1 / old))
    found = np.zeros((side, side), complex)
    found[np.ix_(place, place)] = spectrum[np.ix_(place, place)] * np.outer(turn, turn)
    return np.fft.ifft2(found).real * (side / old) ** 2


def _mean_over_lost(table: Array, deviation: float) -> Array:
    """[4096] of [256]: the means of the values over Gaussian ones of which `deviation` is left,
    at that part of them from -4 to 4 of its own deviations.
    """
    lost = np.sqrt(1 - deviation**2)
    fine = np.linspace(-GAUSSIAN, GAUSSIAN, _FINE)
    known = np.linspace(-GAUSSIAN, GAUSSIAN, table.shape[-1])
    nodes, weights = np.polynomial.hermite_e.hermegauss(32)
    values = np.zeros(_FINE)
    for node, weight in zip(nodes, weights / weights.sum(), strict=True):
        values += weight * np.interp(deviation * fine + lost * node, known, table)
    return values.astype(np.float32)
