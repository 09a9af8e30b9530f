"""Smooth noise in space: the same at a place of the world whatever texture shows it."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..temporal.waves import Wave

__all__ = ("SpaceNoise", "random_numbers")

Array = NDArray[np.float32]

_PERIOD = 32  # cells after which a wave repeats; each is turned and moved on its own
_STRIDES = (_PERIOD**2, _PERIOD, 1)
_LEVELS = 1.3  # lattice values lie in +- this, so that a wave's deviation is about 0.5
_MOST_WAVES = 24


@dataclass(frozen=True)
class SpaceNoise:
    """Waves of value noise, ever finer.

    lattice, turns, moves: where its values come from, and how each wave is turned and moved
    frequency: cells a meter of each wave along x, y and z: [K, 3]
    height: of each, [K]; it goes roughly from minus that to it
    """

    lattice: Array
    turns: NDArray[np.float64]
    moves: NDArray[np.float64]
    frequency: NDArray[np.float64]
    height: NDArray[np.float64]

    @classmethod
    def of(cls, rng: np.random.Generator, waves: Iterable[Wave]) -> SpaceNoise:
        """`waves`, with cells (down, across) a meter, of which at most 24 are taken."""
        told = list(itertools.islice(waves, _MOST_WAVES))
        lattice = rng.uniform(-_LEVELS, _LEVELS, _PERIOD**3).astype(np.float32)
        turns, _ = np.linalg.qr(rng.standard_normal((_MOST_WAVES, 3, 3)))
        moves = rng.uniform(0, _PERIOD, (_MOST_WAVES, 3))
        frequency = np.array([(wave.across, wave.across, wave.down) for wave in told])
        return cls(lattice, turns, moves, frequency, np.array([wave.height for wave in told]))

    def waves_above(self, length: float) -> int:
        """How many waves, from the first, have cells of at least `length` meters, where the cells
        are shortest.
        """
        return int(np.count_nonzero(self.frequency.max(1) * length <= 1))

    def bound(self, first: int, last: int) -> float:
        """What the waves `first` to before `last` do not exceed together."""
        return float(_LEVELS * self.height[first:last].sum())

    def at(self, position: Array, first: int, last: int) -> Array:
        """The sum of the waves `first` to before `last` at positions [n, 3], in meters: [n]."""
        total = np.zeros(len(position), np.float32)
        x, y, z = np.ascontiguousarray(position.T)
        for k in range(first, min(last, len(self.height))):
            # By hand: a product of matrices this thin wakes threads for nothing.
            scaled = (self.frequency[k][:, None] * self.turns[k]).T
            rows = zip(scaled.astype(np.float32), self.moves[k].astype(np.float32), strict=True)
            wave = self._wave(*(a * x + b * y + c * z + move for (a, b, c), move in rows))
            wave *= np.float32(self.height[k])
            total += wave
        return total

    def _wave(self, *cell: Array) -> Array:
        low, high, share = zip(*map(_cells, cell), strict=True)
        x, y, z = ((low[axis] * step, high[axis] * step) for axis, step in enumerate(_STRIDES))

        def between(a: Array, b: Array, part: Array) -> Array:
            b -= a
            b *= part
            b += a
            return b

        def column(row: NDArray[np.int32]) -> Array:
            return between(self.lattice.take(row + z[0]), self.lattice.take(row + z[1]), share[2])

        def plane(layer: NDArray[np.int32]) -> Array:
            return between(column(layer + y[0]), column(layer + y[1]), share[1])

        return between(plane(x[0]), plane(x[1]), share[0])


def _cells(place: Array) -> tuple[NDArray[np.int32], NDArray[np.int32], Array]:
    """The cells below and above each place along an axis, and how far it has come, smoothed."""
    floor = np.floor(place)
    share = place - floor
    share *= share * (3 - 2 * share)
    whole = floor.astype(np.int32)
    return whole & (_PERIOD - 1), (whole + 1) & (_PERIOD - 1), share


def random_numbers(keys: NDArray[np.int64], seed: int) -> NDArray[np.float64]:
    """A number above 0 and below 1 for each key, that of a key whatever other keys there are."""
    with np.errstate(over="ignore"):
        mixed = keys.astype(np.uint64) + np.uint64(seed & (2**64 - 1)) * np.uint64(
            0x9E3779B97F4A7C15
        )
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
        mixed ^= mixed >> np.uint64(31)
    return ((mixed >> np.uint64(11)).astype(np.float64) + 0.5) / 2.0**53
