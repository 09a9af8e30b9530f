"""A scan's history: how its texels change with their distance from the border of what weathered.

Position tells age: what lies farther inside has weathered longer. A front
moves fast at first and slows down,

    d(a) = d0 + D (1 - (1 - a)^k),   D = d1 - d0,

from d0, where the first change begins (paint lifts before it breaks), to d1, from where on nothing
changes any more; k is such that the border is reached at an age of a tenth, as what spreads turns
visibly soon, and goes on slowly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .scan_maps import HEIGHT

__all__ = ("Curves", "curves_by_distance", "seen")

Array = NDArray[np.float32]
Floats = NDArray[np.floating]

FARTHEST = 128
"""Texels; what is farther from a border counts as this far."""

_EDGES = (0, 1.25, 2.25, 3.25, 4.25, 5.5, 7, 9, 12, 16, 22, 30, 42, 60, 90, FARTHEST + 1)
_FEWEST = 64  # texels that a mean is taken of
_BEGUN = 0.1  # share of the whole way by which the first change has begun
_ENDED = 0.06
_DEEPEST = 0.01  # share of the texels: fewer are no mean to trust
_BEYOND = 3  # bins in which it is seen what goes on changing
_LIFTED = 0.2  # share of the height's range likewise
_BORDER = 0.1  # age at which the border is reached
_POWER = (8.0, 30.0)


@dataclass(frozen=True)
class Curves:
    """distance: [B], of the texels in each bin, from clean (negative) to weathered, in texels
    mean, spread: [B, 8] of their values; count: [B]
    clean, weathered: [8], the means far from the border
    drift: [8] what still changes slowly among weathered texels, from the shallow to the deep
    first, last: distances at which change begins and ends
    power: k (see above)
    """

    distance: Array
    mean: Array
    spread: Array
    count: Array
    clean: Array
    weathered: Array
    drift: Array
    first: float
    last: float
    power: float

    def distance_at(self, age: Array) -> Array:
        """How far inside texels of `age` [...] lie, in texels."""
        way = 1 - (1 - np.clip(age, 0, 1)) ** self.power
        return (self.first + (self.last - self.first) * way).astype(np.float32)

    def mean_at(self, distance: Array) -> Array:
        """Mean values [..., 8] at distances [...]."""
        return _at(distance, self.distance, self.mean)

    def spread_at(self, distance: Array | float) -> Array:
        """Standard deviations [..., 8] at distances [...]."""
        return _at(distance, self.distance, self.spread)

    def share_at(self, distance: Array) -> Array:
        """How much of the way from clean to weathered is gone at distances [...], 0 to 1, rising
        with them.
        """
        way = seen(self.weathered) - seen(self.clean)
        gone = ((seen(self.mean) - seen(self.clean)) @ way / (way @ way)).clip(0, 1)
        return np.interp(distance, self.distance, np.maximum.accumulate(gone)).astype(np.float32)


def seen(values: Floats) -> Floats:
    """`values` [..., 8] in steps that look about alike, without height: [..., 7]."""
    return np.concatenate(
        (np.sqrt(np.maximum(values[..., : HEIGHT - 1], 0)), values[..., HEIGHT - 1 : HEIGHT]), -1
    )


def curves_by_distance(values: Array, distance: Array) -> Curves:
    """The history that texels `values` [H, W, 8] at signed `distance` [H, W] tell."""
    edges = np.asarray((*(-edge for edge in _EDGES[:0:-1]), *_EDGES))
    bin = np.searchsorted(edges, distance.ravel()) - 1
    count = np.bincount(bin, minlength=len(edges) - 1).astype(np.float64)
    flat = values.reshape(-1, values.shape[-1])
    powers = ([distance.ravel()], flat.T, np.square(flat.T))
    far, mean, square = (
        np.stack([np.bincount(bin, each, len(count)) for each in some], -1)
        / np.maximum(count, 1)[:, None]
        for some in powers
    )
    kept = count >= _FEWEST
    far, mean, count = far[kept, 0], mean[kept], count[kept]
    spread = np.sqrt(np.maximum(square[kept] - mean**2, 0))
    outside = far < 0
    clean = _plateau(-far[outside][::-1], mean[outside][::-1], count[outside][::-1])
    weathered = _plateau(far[~outside], mean[~outside], count[~outside])
    first, last = _span(far, mean, clean, weathered)
    known = far[count >= _DEEPEST * count.sum()]
    last = min(last, float(max(known[-min(_BEYOND, len(known))], 0.5)))
    before = min(-first / (last - first), 0.99)
    power = float(np.clip(np.log(1 - before) / np.log(1 - _BORDER), *_POWER))
    return Curves(
        *(each.astype(np.float32) for each in (far, mean, spread, count)),
        clean=clean.astype(np.float32),
        weathered=weathered.astype(np.float32),
        drift=_drift(far, mean, count, last).astype(np.float32),
        first=first,
        last=last,
        power=power,
    )


def _plateau(away: Floats, mean: Floats, count: Floats) -> Floats:
    """The mean [8] of the farther half of the texels on one side, which lie `away` from the border
    in rising order: of at least the last bin.
    """
    beyond = np.cumsum(count[::-1])[::-1] <= 0.5 * count.sum()
    beyond[-1] = True
    return np.average(mean[beyond], 0, count[beyond])


def _drift(far: Floats, mean: Floats, count: Floats, last: float) -> Floats:
    """By how much the mean [8] goes on changing from `last` to where there are hardly any texels
    left: the line of least squares.
    """
    beyond = (far >= last) & (count >= _DEEPEST * count.sum())
    if beyond.sum() < 2:
        return np.zeros(mean.shape[1])
    away, weight = far[beyond], count[beyond]
    centered = away - np.average(away, weights=weight)
    slope = (weight * centered) @ mean[beyond] / (weight @ centered**2)
    return slope * np.ptp(away)


def _span(far: Floats, mean: Floats, clean: Floats, weathered: Floats) -> tuple[float, float]:
    """The distances at which the first change begins, and at which the last one ends."""
    whole = np.linalg.norm(seen(weathered) - seen(clean))
    height = mean[:, HEIGHT]
    rise = max(float(np.ptp(height)), 1e-6)

    def changed(end: Floats, least: float) -> NDArray[np.bool_]:
        looks = np.linalg.norm(seen(mean) - seen(end), axis=-1) > least * whole
        return looks | (np.abs(height - end[HEIGHT]) > _LIFTED * rise)

    begun = np.flatnonzero(changed(clean, _BEGUN) & (far > -_most_of(far)))
    running = np.flatnonzero(changed(weathered, _ENDED) & (far < _most_of(far)))
    first = far[max(begun[0] - 1, 0)] if len(begun) else -1.0
    last = far[min(running[-1] + 1, len(far) - 1)] if len(running) else 1.0
    return float(min(first, -0.5)), float(max(last, 0.5))


def _most_of(far: Floats) -> float:
    """A distance that is farther than change can be told from form: half of the farthest."""
    return 0.5 * float(np.abs(far).max())


def _at(distance: Floats | float, known: Floats, values: Floats) -> Array:
    return np.stack([np.interp(distance, known, each) for each in values.T], -1).astype(np.float32)
