"""What water brings down a surface: stains below what weathers, streaks below ledges.

Rain falls on what looks up. From each point water is handed to its lower neighbors, most of it the
steepest way, and evaporates as it goes; what weathers dissolves into it and settles below.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .graph import Graph
from .noise import SpaceNoise
from .points import Points

__all__ = ("deposit",)

Array = NDArray[np.float32]

_STEEPEST = 4  # power of the slope by which lower neighbors share
_WANDER = 1.0  # spacings that a surface is uneven by: runs wander and join
_LONGEST, _OCTAVES, _GAIN = 32.0, 5, 0.65  # of this unevenness: spacings a cell, and its octaves
_DRIZZLE = 0.06  # rain on what does not look up, of that on what does
_DRIES, _SETTLES = (
    0.35,
    0.12,
)  # units after which 1 / e of the water, and of what it carries, is left
_SOURCES = (0.8, 0.98)  # of the surface: from here to there what is susceptible gives all it can
_RUNS = 0.97  # of the surface with any deposit: what has the most
_CONTRAST = 0.6  # power: thin stains show
_SETTLED = 1e-4  # of all water: less than this makes no difference
_MOST_SWEEPS = 2000


def deposit(
    points: Points,
    graph: Graph,
    *,
    susceptibility: Array,
    sky: Array,
    unit: float,
    rng: np.random.Generator,
) -> Array:
    """How much has settled on each point, 0 to 1, of what the most susceptible ones gave: [n].

    `sky` is how much of it each point sees, 0 to 1; `unit` is in meters.
    """
    frequency = 1 / (_LONGEST * points.spacing)
    uneven = SpaceNoise.of(rng, (frequency, frequency, frequency), _GAIN)
    uneven = uneven.at(points.position, 0, _OCTAVES)
    share = _shares(points, graph, points.position[:, 2] + _WANDER * points.spacing * uneven)

    def left(length: float) -> np.float32:
        return np.float32(np.exp(-points.spacing / (length * unit)))

    rain = points.area * (np.maximum(points.normal[:, 2], 0) * sky + _DRIZZLE)
    water = _handed_down(graph, share * left(_DRIES), rain)
    low, high = np.quantile(susceptibility, _SOURCES)
    gives = ((susceptibility - low) / max(high - low, 1e-6)).clip(0, 1)
    carried = _handed_down(graph, share * left(_SETTLES), (water * gives).astype(np.float32))
    settled = carried / points.area
    if not settled.any():
        return np.zeros(len(points), np.float32)
    most = np.quantile(settled[settled > 0], _RUNS)
    return ((settled / most).clip(0, 1) ** _CONTRAST).astype(np.float32)


def _shares(points: Points, graph: Graph, height: Array) -> Array:
    """The share of its water that each neighbor hands to a point, [NEIGHBORS, n]."""
    slope = np.maximum(graph.between(height) / graph.distance, 0) ** _STEEPEST
    handed = np.bincount(graph.neighbor.reshape(-1), slope.reshape(-1), len(points))
    return (slope / np.maximum(handed, 1e-12)[graph.neighbor]).astype(np.float32)


def _handed_down(graph: Graph, share: Array, source: Array) -> Array:
    """What is at each point in the end of what comes from `source` and is handed on: [n]."""
    total, moving = source, source
    enough = _SETTLED * float(source.sum(dtype=np.float64))
    for _ in range(_MOST_SWEEPS):
        below = np.zeros_like(moving)
        for neighbor, part in zip(graph.neighbor, share, strict=True):
            below += moving.take(neighbor) * part
        moving = below
        total = total + moving
        if float(moving.sum(dtype=np.float64)) <= enough:
            break
    return total
