"""When something that spreads over a surface arrives at each of its points.

Nuclei appear by chance, and sooner and closer to each other where the surface is exposed to the
process; from them it spreads, faster where it is exposed, at the speeds across, down and up of the
process. Chance is noise in space. All points are born at last, so that little is left to chance
where an artist wants none of it.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..temporal.processes import Growth
from ..temporal.waves import Wave, octaves
from .exposure import SOUGHT, WEAR, Exposure
from .graph import Graph, arrival
from .noise import SpaceNoise, random_numbers
from .points import Points

__all__ = ("Chance", "grow", "usual_unit")

Array = NDArray[np.float32]

_SIDES = 1.25  # of the square that has the surface's area, in a tile's: half a cube shows at a time
_STEPS = 4.0  # sizes of the default unit to a doubling
_SEEKING = 3.0  # log-density of nuclei for a susceptibility of 1
_EASE = 1.2  # log-speed, likewise
_HEAD_START = 1.6  # of births, likewise, in times that the process takes from nucleus to nucleus
_OWN = 1.5  # by how many of these times a point is born later where there is no nucleus
_LEAST_CHANCE = 0.1
_AHEAD = 2.0  # times from nucleus to nucleus that it starts earlier where it is told to
_SOUGHT_AHEAD = 1.5  # times from nucleus to nucleus that it starts earlier where a mask seeks it
_OCTAVES = 3


@dataclass(frozen=True)
class Chance:
    """Random streams of a pattern; a `unit` is the length in meters of what the numbers of a
    `Growth` call a tile's side.
    """

    process: str
    seed: int
    unit: float

    def rng(self, purpose: str) -> np.random.Generator:
        words = (
            self.seed & (2**64 - 1),
            *map(zlib.crc32, (self.process.encode(), purpose.encode())),
        )
        return np.random.default_rng(words)

    def noise(self, purpose: str, waves: Iterable[Wave]) -> SpaceNoise:
        """Of `waves` with cells to a unit."""
        return SpaceNoise.of(self.rng(purpose), (wave.scaled(1 / self.unit) for wave in waves))


def usual_unit(area: float) -> float:
    """The unit in meters of a surface of so many square meters, the same for its smaller copy."""
    unit = max(np.sqrt(area) / _SIDES, 1e-9)
    return float(2.0 ** (round(np.log2(unit) * _STEPS) / _STEPS))


def grow(
    growth: Growth,
    points: Points,
    graph: Graph,
    *,
    exposure: Exposure,
    known: Mapping[str, Array],
    chance: Chance,
    starts: NDArray[np.int64],
) -> Array:
    """Arrival times [n], in units of what speed 1 needs to cross a unit.

    `known` features [n] of the points, 0 to 1, count by their weights in `exposure`.
    It begins at the points `starts` [k] before anywhere else.
    """
    susceptibility = exposure.susceptibility(known)
    patches = chance.noise("patches", octaves(growth.clusters, 0.5))
    uneven = chance.noise("slowness", octaves(growth.grain, 0.5))
    delay = 0.5 * growth.cluster_delay * (1 + patches.at(points.position, 0, _OCTAVES))

    apart = 1 / np.sqrt(growth.nuclei)
    usual = apart / growth.across + 0.5 * (growth.cluster_delay + growth.birth_spread)
    usual += growth.wandering
    seed = int(chance.rng("nuclei").integers(1 << 62))
    late = random_numbers(points.key, seed)
    race = -np.log(random_numbers(points.key, seed + 1)) / points.area
    race *= np.exp(-_SEEKING * susceptibility)
    area = points.area.sum(dtype=np.float64)
    count = int(np.clip(round(growth.nuclei * area / chance.unit**2), 3, max(len(points) // 8, 3)))
    nucleus = race <= np.partition(race, min(count, len(race)) - 1)[min(count, len(race)) - 1]
    births = delay + growth.birth_spread * late + np.where(nucleus, 0, _OWN * usual)
    births = exposure.pattern * births - _HEAD_START * usual * susceptibility
    if SOUGHT in known:
        births = births - _SOUGHT_AHEAD * usual * known[SOUGHT]
    if WEAR in known and exposure.wear > 0:
        births = np.where(known[WEAR] > 0.5, births.min(), births)
    pace = np.float32(max(exposure.pattern, _LEAST_CHANCE))
    births[starts] = births.min() - _AHEAD * usual / pace

    slowness = (
        np.exp(
            exposure.pattern * growth.unevenness * uneven.at(points.position, 0, _OCTAVES)
            - _EASE * susceptibility
        )
        / pace
    )
    return arrival(
        graph,
        births.astype(np.float32),
        _costs(growth, points, graph, slowness) / np.float32(chance.unit),
    )


def _costs(growth: Growth, points: Points, graph: Graph, slowness: Array) -> Array:
    """Times [NEIGHBORS, n] from each neighbor, in meters at speed 1."""
    rise = -graph.between(points.position[:, 2]) / graph.distance
    toward = np.where(rise > 0, np.float32(growth.up), np.float32(growth.down))
    speed = growth.across + (toward - np.float32(growth.across)) * np.abs(rise)
    mean = (slowness[graph.neighbor] + slowness) / 2
    return (graph.distance * mean / speed).astype(np.float32)
