"""The pattern in which a source weathered: how large, long and ragged its regions are.

What has weathered so far is taken for where a field is high: the more alike two places are in that
field, the rarer one has weathered and the other not. For a normal field the one follows from the
other, so that the map of what is weathered tells how alike the field is at every distance down and
across. A sum of waves is fitted to that, each with a size of its own down and across: streaks, the
grain of wood, crumbs at the border. Growth itself has a share in it, at the source's size and as
much longer than wide as the waves are.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from model_runtime.temporal.onset import arrivals
from model_runtime.temporal.pace import Timing
from model_runtime.temporal.waves import Wave

__all__ = ("waves_of",)

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LAGS = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)  # texels, down and across
_CELLS = tuple(2.0**k for k in range(1, 10))  # to a side
_LONGEST = 16.0  # times as long as wide
_MOST = 16  # waves; what more would add is not seen
_FAINTEST = 1e-3  # share of the whole
_NEAR = 0.05  # errors count by how unalike places that far from each other are, and by this more
_FAR = 50.0  # texels from which on they count half
_GROWTH = (0.08, 0.25)  # share of growth in the field, at least and at most:
_ROOM = 0.5  # at no distance more than this of what sets two places apart
_SMOOTH = 0.75  # alike by exp(-0.75 d^2) at d cells: what a spline through random values is
_DEVIATION = 0.47  # of a wave of height 1
_STEPS = 20_000
_FEWEST_TEXELS = 64


def waves_of(weathered: Mask, *, scale: float, process: str, seed: int = 0) -> tuple[Wave, ...]:
    """The waves of a pattern in which as much starts together as in `weathered` [H, W], where its
    onsets are half alike at `scale` (in longer sides of the map), for a `Timing`; none where the
    map is too small or of one kind.
    """
    if min(weathered.shape) < _FEWEST_TEXELS or weathered.all() or not weathered.any():
        return ()
    side = max(weathered.shape)
    lags = np.array([lag for lag in _LAGS if lag <= min(weathered.shape) // 2])
    alike = _correlation(_apart(weathered, int(lags[-1])), float(weathered.mean()))
    alike = alike[np.ix_(lags, lags)]
    first = _fitted(alike, alike, lags / side)
    timing = Timing.of(0.0, scale=scale, waves=_sized(first, scale))
    growth = arrivals(process, timing, seed=seed)
    grown = _correlation_of(growth, lags / side)
    room = ((1 - alike) / np.maximum(1 - grown, 1e-9)).ravel()[1:].min()
    share = float(np.clip(_ROOM * room, *_GROWTH))
    waves = _fitted(alike - share * grown, alike, lags / side)
    height = growth.std() / math.sqrt(share) / _DEVIATION
    return _sized([wave._replace(height=height * wave.height) for wave in waves], scale)


def _sized(waves: list[Wave], scale: float) -> tuple[Wave, ...]:
    """With cells to the length `scale` instead of to a side, ever finer."""
    return tuple(wave.scaled(scale) for wave in sorted(waves, key=lambda each: max(each[:2])))


def _apart(weathered: Mask, longest: int) -> Floats:
    """How often one of two texels is weathered and the other is not, by how many texels the second
    lies below the first and beside it, on whichever side: [longest + 1, longest + 1].
    """
    given = weathered.astype(np.float64)
    padded = tuple(length + longest for length in given.shape)  # nothing wraps within these lags
    seen, there = (np.fft.rfft2(each, padded) for each in (given, np.ones_like(given)))
    both, pairs, ones = (
        np.fft.irfft2(each, padded)
        for each in (np.abs(seen) ** 2, np.abs(there) ** 2, 2 * (seen * np.conj(there)).real)
    )
    share = (ones - 2 * both) / np.maximum(pairs, 1)
    right = share[: longest + 1, : longest + 1]
    left = share[: longest + 1, -np.arange(longest + 1)]
    return (right + left) / 2


def _correlation(apart: Floats, share: float) -> Floats:
    """The correlation, not below 0, of a normal field that is high in a `share` of the places and
    at two places, high at one and low at the other, so often: the integral of the binormal density
    at that height over the correlation (Plackett 1954).
    """
    angle = np.linspace(0, np.pi / 2, _STEPS + 1)
    level = _level(share)
    density = np.exp(-level * level / (1 + np.sin(angle))) / (2 * np.pi)
    steps = (density[1:] + density[:-1]) / 2 * np.diff(angle)
    expected = 2 * np.cumsum(steps[::-1])[::-1]  # from each angle on; none where all are alike
    expected = np.append(expected, 0.0)
    return np.interp(-apart, -expected, np.sin(angle))


def _level(share: float) -> float:
    """What a normal number exceeds with a chance of `share`, by bisection."""
    low, high = -8.0, 8.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (
            (middle, high) if 0.5 * math.erfc(middle / math.sqrt(2)) > share else (low, middle)
        )
    return low


def _correlation_of(growth: Floats, lags: Floats) -> Floats:
    """How alike the arrivals of a tile that wraps are in their ranks, as normal numbers, at `lags`
    (in sides) down and across: [K, K].
    """
    side = len(growth)
    ranks = np.argsort(np.argsort(growth, axis=None)).reshape(growth.shape)
    table = np.array([_level(share) for share in np.linspace(0.999, 0.001, 257)])
    normal = np.interp((ranks + 0.5) / growth.size, np.linspace(0.001, 0.999, 257), table)
    spectrum = np.abs(np.fft.rfft2(normal - normal.mean())) ** 2
    alike = np.fft.irfft2(spectrum, growth.shape)
    alike = (alike + alike[:, -np.arange(side)]) / 2 / alike[0, 0]
    place = lags * side
    lower = place.astype(int)
    part = place - lower
    down = alike[lower] * (1 - part)[:, None] + alike[lower + 1] * part[:, None]
    return down[:, lower] * (1 - part) + down[:, lower + 1] * part


def _fitted(alike: Floats, whole: Floats, lags: Floats) -> list[Wave]:
    """Waves, with cells to a side, of whose field places at `lags` down and across are `alike`
    [K, K]; `whole` is that of all there is.
    """
    sizes = [
        (down, across)
        for down in _CELLS
        for across in _CELLS
        if max(down, across) <= _LONGEST * min(down, across) and lags[1] * max(down, across) <= 0.5
    ]
    along = {cells: np.exp(-_SMOOTH * np.square(lags * cells)) for cells in _CELLS}
    columns = np.stack([np.outer(along[down], along[across]).ravel() for down, across in sizes], 1)
    away = np.add.outer(lags, lags) / lags[1]
    weight = (1 / (1 + away / _FAR) / (1 - whole + _NEAR)).ravel()
    shares = _nonnegative(columns * weight[:, None], alike.ravel() * weight)
    return [
        Wave(*cells, math.sqrt(share))
        for cells, share in zip(sizes, shares, strict=True)
        if share > _FAINTEST
    ]


def _nonnegative(columns: Floats, wanted: Floats) -> Floats:
    """x, none below 0 and at most 16 above it, for which `columns` x is nearly `wanted` by least
    squares (Lawson and Hanson 1974).
    """
    x = np.zeros(columns.shape[1])
    used = np.zeros(len(x), bool)
    while used.sum() < _MOST:
        slope = np.where(used, -np.inf, columns.T @ (wanted - columns @ x))
        if slope.max() <= 1e-9:
            break
        used[slope.argmax()] = True
        while True:
            best = np.zeros_like(x)
            best[used] = np.linalg.lstsq(columns[:, used], wanted, rcond=None)[0]
            below = used & (best <= 0)
            if not below.any():
                break
            step = (x[below] / np.maximum(x[below] - best[below], 1e-300)).min()
            x += step * (best - x)
            used &= x > 1e-12
            x[~used] = 0
        x = best
    return x
