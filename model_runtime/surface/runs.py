"""What water brings down a surface: stains below what weathers, streaks below ledges.

Rain falls on what looks up. From each point water is handed to its lower neighbors, most of it the
steepest way, and evaporates as it goes; what weathers early dissolves into it and settles below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..temporal.waves import octaves
from .graph import Graph
from .noise import SpaceNoise
from .points import Points

__all__ = ("Deposit", "Runs", "deposit", "runs")

Array = NDArray[np.float32]

_STEEPEST = 4  # power of the slope by which lower neighbors share
_GIVERS = 7  # neighbors that hand water to a point: hardly any are higher than more others
_STEEP = 0.2  # sine of the slope from which water runs off; on what is level it stands
_WANDER = 1.0  # spacings that a surface is uneven by: runs wander and join
_LONGEST, _OCTAVES, _GAIN = 32.0, 5, 0.65  # of this unevenness: spacings a cell, and its octaves
_DRIZZLE = 0.06  # rain on what does not look up, of that on what does
_DRIES, _SETTLES = 0.35, 0.2  # units after which 1 / e of water, and of what it carries, is left
_SOURCES = (
    0.05,
    0.2,
)  # of the surface: what weathers so early gives all it can, what later nothing
_RUNS = 0.97  # of the surface with any deposit: what has the most
_CONTRAST = 0.6  # power: thin stains show
_SOON = 3  # power: a faint stain starts nearly as soon as a strong one
_SETTLED = 1e-4  # of all water: less than this makes no difference
_MOST_SWEEPS = 2000


@dataclass(frozen=True)
class Deposit:
    """What has settled on points, 0 to 1, and when what it comes from began: [n] each."""

    settled: Array
    began: Array


@dataclass(frozen=True)
class Runs:
    """What runs do to points, [n] each: by how much sooner each starts for what runs down to it
    (below 0: later), and how strongly it is stained, 0 to 1.
    """

    sooner: Array
    stain: Array


def runs(weight: float, arrival: Array, found: Deposit) -> Runs:
    """By the `weight` of runs, -1 to 1: what settles starts when its source did, or last of all."""
    share = np.float32(abs(weight)) * found.settled
    if weight < 0:
        return Runs(share * (arrival - arrival.max()), np.zeros_like(arrival))
    soon = 1 - (1 - share) ** _SOON
    return Runs(soon * np.maximum(arrival - found.began, 0), share)


def deposit(
    points: Points,
    graph: Graph,
    arrival: Array,
    *,
    sky: Array,
    unit: float,
    rng: np.random.Generator,
    amount: float = 1.0,
) -> Deposit:
    """What settles below the points at which weathering arrives first, by its `arrival` [n].

    `sky` is how much of it each point sees, 0 to 1; `unit` is in meters; an `amount` of the surface
    weathers at all.
    """
    frequency = 1 / (_LONGEST * points.spacing)
    uneven = SpaceNoise.of(rng, octaves((frequency, frequency), _GAIN))
    uneven = uneven.at(points.position, 0, _OCTAVES)
    height = points.position[:, 2] + _WANDER * points.spacing * uneven
    downhill = _Downhill.of(points, graph, height)

    def left(length: float) -> np.float32:
        return np.float32(np.exp(-points.spacing / (length * unit)))

    rain = points.area * (np.maximum(points.normal[:, 2], 0) * sky + _DRIZZLE)
    water = downhill.handed(rain, left(_DRIES))
    given = (water * _sources(points, arrival, amount)).astype(np.float32)
    since = arrival - arrival.min()
    carried, dated = (downhill.handed(each, left(_SETTLES)) for each in (given, given * since))
    began = (arrival.min() + dated / np.maximum(carried, 1e-30)).astype(np.float32)
    settled = carried / points.area
    if not settled.any():
        return Deposit(np.zeros_like(arrival), arrival)
    most = np.quantile(settled[settled > 0], _RUNS)
    return Deposit(((settled / most).clip(0, 1) ** _CONTRAST).astype(np.float32), began)


def _sources(points: Points, arrival: Array, amount: float) -> Array:
    """How much of what it can each point gives to water, 0 to 1: [n]."""
    order = np.argsort(arrival)
    until = np.searchsorted(arrival[order], arrival, "right") - 1
    share = np.cumsum(points.area[order], dtype=np.float64)[until] / points.area.sum()
    first, last = _SOURCES
    last = min(last, max(amount, 1e-6))  # what never starts gives nothing
    return ((last - share) / (last - min(first, last / 2))).clip(0, 1)


@dataclass(frozen=True)
class _Downhill:
    """The neighbors that hand most water to each point, and the shares of theirs, [_GIVERS, n]."""

    neighbor: NDArray[np.int32]
    share: Array

    @classmethod
    def of(cls, points: Points, graph: Graph, height: Array) -> _Downhill:
        slope = np.maximum(graph.between(height) / graph.distance, 0) ** _STEEPEST
        handed = np.bincount(graph.neighbor.reshape(-1), slope.reshape(-1), len(points))
        steep = np.linalg.norm(points.normal[:, :2], axis=-1)
        kept = np.minimum(steep / _STEEP, 1) / np.maximum(handed, 1e-12)
        share = (slope * kept[graph.neighbor]).astype(np.float32)
        most = np.argsort(-share, axis=0)[:_GIVERS]
        neighbor = np.take_along_axis(graph.neighbor, most, 0)
        return cls(neighbor, np.take_along_axis(share, most, 0))

    def handed(self, source: Array, left: np.float32) -> Array:
        """What is at each point in the end of what comes from `source` and is handed on, of which
        so much is `left` after each step: [n].
        """
        total, moving = source, source
        enough = _SETTLED * float(source.sum(dtype=np.float64))
        share = self.share * left
        for _ in range(_MOST_SWEEPS):
            below = np.zeros_like(moving)
            for neighbor, part in zip(self.neighbor, share, strict=True):
                below += moving.take(neighbor) * part
            moving = below
            total = total + moving
            if float(moving.sum(dtype=np.float64)) <= enough:
                break
        return total
