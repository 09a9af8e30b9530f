"""When what grows arrives at any place of a surface, not yet ranked: the same for maps of any size.

The last are kept: an artist looks where it starts before it ages, and ages it again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..temporal.pace import Timing
from ..temporal.processes import Growth, growth_of
from ..temporal.waves import octaves
from .atlas import Atlas, Places
from .exposure import Exposure, features, marked
from .graph import join
from .growth import Chance, grow, usual_unit
from .interpolation import Interpolation
from .noise import SpaceNoise
from .points import Points, sample
from .runs import deposit, runs

__all__ = ("Asked", "Waves", "waves_of")

Array = NDArray[np.float32]

_COARSE = 4.0  # spacings of points: noise with cells longer than this is laid on them


@dataclass(frozen=True)
class Asked:
    """What a growth is asked for, but for what it grows on; the terms are `surface_timing`'s.

    marked: names and maps of what is said of the atlas's texels, as bytes of singles
    """

    process: str
    seed: int
    exposure: Exposure
    timing: Timing | None
    pattern_size: float | None
    amount: float
    starts: tuple[tuple[float, float, float], ...]
    marked: tuple[tuple[str, bytes], ...]

    def marks(self, size: tuple[int, int]) -> Mapping[str, Array]:
        """The maps [H, W] of what is said of an atlas of this size, by name."""
        return {name: np.frombuffer(each, np.float32).reshape(size) for name, each in self.marked}


@dataclass(frozen=True)
class _Octaves:
    """Noise whose `coarse` long waves are laid on points, and whose short ones on texels."""

    noise: SpaceNoise
    coarse: int

    @classmethod
    def of(cls, noise: SpaceNoise, spacing: float) -> _Octaves:
        return cls(noise, noise.waves_above(_COARSE * spacing))

    def long(self, position: Array) -> Array:
        return self.noise.at(position, 0, self.coarse)

    def short(self, position: Array, texel: float) -> Array:
        """Down to waves of a texel of so many meters."""
        return self.noise.at(position, self.coarse, self._end(texel))

    def range(self, long: tuple[float, float], texel: float) -> tuple[float, float]:
        """What values from `long` to `long` come to with all short ones."""
        bound = self.noise.bound(self.coarse, self._end(texel))
        return long[0] - bound, long[1] + bound

    def _end(self, texel: float) -> int:
        return max(self.coarse, self.noise.waves_above(texel))


@dataclass(frozen=True)
class Waves:
    """Arrivals and mottling, known at points and refined at texels; and what runs do, if anything.

    pattern: how it grew; unit: meters to what the numbers of that call a tile's side
    late, slow: the least and the most of arrivals and of mottling at points
    """

    growth: Growth
    unit: float
    points: Points
    field: Interpolation
    border: _Octaves
    mottling: _Octaves
    late: tuple[float, float]
    slow: tuple[float, float]

    def at(self, places: Places, texel: float) -> Array:
        """Arrivals and mottling of these places [n], whose texels have so many meters a side, and
        what runs do to them: [2 or 4, n].
        """
        found = self.field.at(places.position, self.points.at(places))
        found[0] += self.border.short(places.position, texel)
        found[1] -= self.mottling.short(places.position, texel)
        return found

    def ranges(self, texel: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Between what arrivals lie, and mottling."""
        return self.border.range(self.late, texel), self.mottling.range(self.slow, texel)


@lru_cache(maxsize=1)
def waves_of(atlas: Atlas, asked: Asked) -> Waves:
    """What is `asked` for, grown over the surface that `atlas` shows."""
    points = sample(atlas)
    graph = join(points)
    if asked.pattern_size is None:
        growth = growth_of(asked.process, asked.timing)
        unit = usual_unit(float(points.area.sum(dtype=np.float64)))
    else:
        sized = asked.timing and replace(asked.timing, scale=None)
        growth = growth_of(asked.process, sized)
        unit = asked.pattern_size / growth.scale
    chance = Chance(asked.process, asked.seed, unit)
    known = {**features(atlas, points, graph), **marked(points, asked.marks(atlas.size))}
    arrival = grow(
        *(growth, points, graph),
        exposure=asked.exposure,
        known=known,
        chance=chance,
        starts=points.nearest(asked.starts, atlas.origin),
    )
    border, mottling = (
        _Octaves.of(chance.noise(purpose, waves), points.spacing)
        for purpose, waves in (
            ("border", growth.waves()),
            ("rate", octaves(growth.grain, growth.gain)),
        )
    )
    ragged = np.float32(growth.raggedness)
    late = arrival / ragged + border.long(points.position)
    slow = -mottling.long(points.position)
    fields = [late, slow]
    if asked.exposure.runs:
        settled = deposit(
            *(points, graph, arrival),
            sky=known["sky"],
            unit=unit,
            rng=chance.rng("runs"),
            amount=asked.amount,
        )
        down = runs(asked.exposure.runs, arrival, settled)
        late = fields[0] = late - down.sooner / ragged
        fields += [down.sooner / ragged, down.stain]
    field = Interpolation.of(points, graph, np.stack(fields, -1))
    ranges = ((float(each.min()), float(each.max())) for each in (late, slow))
    return Waves(growth, unit, points, field, border, mottling, *ranges)
