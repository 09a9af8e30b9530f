"""Smooth noise in space: the same at a place of the world whatever texture shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ("SpaceNoise", "random_numbers")

Array = NDArray[np.float32]

_PERIOD = 32  # cells after which an octave repeats; each is turned and moved on its own
_STRIDES = (_PERIOD**2, _PERIOD, 1)
_LEVELS = 1.3  # lattice values lie in +- this, so that an octave's deviation is about 0.5
_MOST_OCTAVES = 24


@dataclass(frozen=True)
class SpaceNoise:
    """Octaves of value noise, roughly -1 to 1 in the first one.

    rng: where the lattice, the turns and the moves of the octaves come from
    frequency: cells a meter of the first octave along x, y and z; each octave doubles them
    gain: amplitude ratio from one octave to the next finer one
    """

    lattice: Array
    turns: NDArray[np.float64]
    moves: NDArray[np.float64]
    frequency: tuple[float, float, float]
    gain: float

    @classmethod
    def of(
        cls, rng: np.random.Generator, frequency: tuple[float, float, float], gain: float
    ) -> SpaceNoise:
        lattice = rng.uniform(-_LEVELS, _LEVELS, _PERIOD**3).astype(np.float32)
        turns, _ = np.linalg.qr(rng.standard_normal((_MOST_OCTAVES, 3, 3)))
        moves = rng.uniform(0, _PERIOD, (_MOST_OCTAVES, 3))
        return cls(lattice, turns, moves, frequency, gain)

    def octaves_above(self, length: float) -> int:
        """How many octaves have cells of at least `length` meters, where the cells are shortest."""
        cells = max(self.frequency) * length
        return int(np.clip(np.floor(-np.log2(max(cells, 1e-9))) + 1, 0, _MOST_OCTAVES))

    def bound(self, first: int, last: int) -> float:
        """What the octaves `first` to before `last` do not exceed together."""
        return float(_LEVELS * sum(self.gain**k for k in range(first, last)))

    def at(self, position: Array, first: int, last: int) -> Array:
        """The sum of the octaves `first` to before `last` at positions [n, 3], in meters: [n]."""
        total = np.zeros(len(position), np.float32)
        x, y, z = np.ascontiguousarray(position.T)
        for k in range(first, last):
            # By hand: a product of matrices this thin wakes threads for nothing.
            scaled = (np.array(self.frequency)[:, None] * self.turns[k] * 2.0**k).T
            rows = zip(scaled.astype(np.float32), self.moves[k].astype(np.float32), strict=True)
            octave = self._octave(*(a * x + b * y + c * z + move for (a, b, c), move in rows))
            octave *= np.float32(self.gain**k)
            total += octave
        return total

    def _octave(self, *cell: Array) -> Array:
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
