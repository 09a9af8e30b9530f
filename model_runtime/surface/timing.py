"""The timing of an object's texels: when each starts to age and how fast it does, by its place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..temporal.pace import Timing
from ..temporal.processes import Growth, growth_of, pace_of
from ..temporal.ranks import Ranking
from .atlas import Atlas, Places
from .exposure import Exposure, features
from .graph import Graph, join
from .growth import WEAR, Chance, grow, usual_unit
from .interpolation import Interpolation
from .noise import SpaceNoise
from .points import Points, sample
from .runs import Runs, deposit, runs
from .seams import Seen

__all__ = ("SurfaceTiming", "surface_timing")

Array = NDArray[np.float32]

_CHUNK = 1 << 16  # texels of a step
_WORKERS = 2
_COARSE = 4.0  # spacings of points: noise with cells longer than this is laid on them
_WHITE = 0.999  # of what blocks: such texels never start
_STAINS = (0.0, 0.1)
_LEAST = np.float32(1e-3)
_CURVE = np.linspace(0, 1, 11).round(1)  # times at which `aged.json` tells how much has started


@dataclass(frozen=True)
class SurfaceTiming:
    """When texels start, 0 to 1 (1: never), and how fast they run, above 0 to 1: [H, W] each.

    What no face covers has what the nearest texel has. `seam_ratio` is None where there is no seam;
    `account` is `surface` of `aged.json`.
    """

    onset: Array
    rate: Array
    seam_ratio: float | None
    account: dict[str, Any]


@dataclass(frozen=True)
class _Octaves:
    """Noise whose long waves are laid on points, and whose short ones, down to a texel, on texels.

    coarse, fine: how many octaves are the points', and where the texels' end
    """

    noise: SpaceNoise
    coarse: int
    fine: int

    @classmethod
    def of(cls, noise: SpaceNoise, *, spacing: float, texel: float) -> _Octaves:
        coarse = noise.octaves_above(_COARSE * spacing)
        return cls(noise, coarse, max(coarse, noise.octaves_above(texel)))

    def long(self, position: Array) -> Array:
        return self.noise.at(position, 0, self.coarse)

    def short(self, position: Array) -> Array:
        return self.noise.at(position, self.coarse, self.fine)

    def range(self, long: Array) -> tuple[float, float]:
        bound = self.noise.bound(self.coarse, self.fine)
        return float(long.min()) - bound, float(long.max()) + bound


@dataclass(frozen=True)
class _Waves:
    """What is not yet ranked: arrivals and mottling, known at points and refined at texels; and
    what runs do, if anything.

    Both are ranked by the area of the texels that they are asked for, of those that start.
    """

    field: Interpolation
    points: Points
    border: _Octaves
    mottling: _Octaves
    arrivals: Ranking
    slowness: Ranking

    @classmethod
    def of(
        cls,
        growth: Growth,
        points: Points,
        graph: Graph,
        arrival: Array,
        down: Runs | None,
        *,
        chance: Chance,
        texel: float,
    ) -> _Waves:
        """`arrival` at the points, what runs `down` them, and texels of so many meters a side."""
        border, mottling = (
            _Octaves.of(
                chance.noise(purpose, growth.grain, growth.gain),
                spacing=points.spacing,
                texel=texel,
            )
            for purpose in ("border", "rate")
        )
        ragged = np.float32(growth.raggedness)
        late = arrival / ragged + border.long(points.position)
        slow = -mottling.long(points.position)
        fields = [late, slow]
        if down is not None:
            late = fields[0] = late - down.sooner / ragged
            fields += [down.sooner / ragged, down.stain]
        return cls(
            Interpolation.of(points, graph, np.stack(fields, -1)),
            points,
            border,
            mottling,
            Ranking(*border.range(late)),
            Ranking(*mottling.range(slow)),
        )

    def at(self, places: Places) -> Array:
        """Arrivals and mottling of these places [n], and what runs do to them: [2 or 4, n]."""
        found = self.field.at(places.position, self.points.at(places))
        found[0] += self.border.short(places.position)
        found[1] -= self.mottling.short(places.position)
        return found


@dataclass(frozen=True)
class _Laid:
    """Maps [H, W] of arrivals and mottling, and of what runs do where they do anything, [2 or 4, H,
    W], 0 where no face is; and of what is blocked for good.
    """

    waves: Array
    never: NDArray[np.bool_]

    @classmethod
    def of(cls, waves: _Waves, atlas: Atlas, covered: NDArray[np.bool_]) -> _Laid:
        """Of the texels that are `covered`, all of whose waves are ranked on the way."""
        size = covered.shape[0], covered.shape[1]
        laid = cls(np.zeros((waves.field.count, *size), np.float32), np.zeros(size, bool))
        maps = laid.waves.reshape(waves.field.count, -1)
        blocked = atlas.features.get("blocked", np.zeros_like(atlas.area)).reshape(-1) >= _WHITE
        counted = _counted(atlas, blocked)

        def lay(rows: range) -> tuple[Array, Array, Array]:
            """Arrivals and mottling of these rows, and the area of each texel."""
            places = atlas.places(covered, rows)
            found = waves.at(places)
            maps[:, places.texel] = found
            laid.never.reshape(-1)[places.texel] = blocked.take(places.baked)
            return found[0], found[1], counted.take(places.baked)

        with ThreadPoolExecutor(_WORKERS) as workers:
            for late, slow, area in workers.map(lay, _chunks(size)):
                waves.arrivals.add(late, area)
                waves.slowness.add(slow, area)
        return laid


def surface_timing(
    atlas: Atlas,
    process: str,
    size: tuple[int, int],
    *,
    seed: int,
    exposure: Exposure,
    timing: Timing | None = None,
    pattern_size: float | None = None,
    amount: float = 1.0,
    stains: Sequence[float] = _STAINS,
    starts: Sequence[tuple[float, float, float]] = (),
) -> SurfaceTiming:
    """The timing of a map of `size` of the surface that `atlas` shows.

    What the atlas knows as worn starts at once, and the pace is that of the others.
    `pattern_size` is the distance in meters at which onsets are about half as alike as one is to
    itself; None: that of the process, on a surface of this area. An `amount` of the surface ever
    starts, 0 to 1. `timing` sets the pace, and the scale where no `pattern_size` does. Stains of
    ever more strength, in equal steps, end at the ages `stains`. It begins at the places `starts`,
    in meters of the world, before anywhere else. The same arguments give the same maps, and another
    size the same pattern.
    """
    points = sample(atlas)
    graph = join(points)
    total = float(points.area.sum(dtype=np.float64))
    if pattern_size is None:
        growth, unit = growth_of(process, timing), usual_unit(total)
    else:
        growth = growth_of(process, None)
        unit = pattern_size / growth.scale
    chance = Chance(process, seed, unit)
    known = features(atlas, points, graph)
    begin = points.nearest(starts, atlas.origin)
    how = {"exposure": exposure, "known": known, "chance": chance, "starts": begin}
    arrival = grow(growth, points, graph, **how)
    down = None
    if exposure.runs:
        settled = deposit(
            *(points, graph, arrival),
            sky=known["sky"],
            unit=unit,
            rng=chance.rng("runs"),
            amount=amount,
        )
        down = runs(exposure.runs, arrival, settled)
    texel = atlas.spacing_at(size)
    waves = _Waves.of(growth, points, graph, arrival, down, chance=chance, texel=texel)
    covered = atlas.covered_at(size)
    laid = _Laid.of(waves, atlas, covered)
    onset, rate = _paced(laid, waves, growth, timing, amount, stains)
    seen = Seen.of(atlas, onset)
    for rows in _chunks(size):
        beside, source = atlas.beside(covered, rows)
        for pixels in (onset, rate):
            pixels.reshape(-1)[beside] = pixels.reshape(-1).take(source)
    account = {
        "maps": ["position", "normal", *sorted(atlas.features.keys() - {WEAR})],
        "points": len(points),
        "area": round(total, 9),
        "pattern_size": round(unit * growth.scale, 9),
        "exposure": exposure.json(),
        "started": dict(zip(map(str, _CURVE.tolist()), seen.share_below(_CURVE), strict=True)),
    }
    return SurfaceTiming(onset, rate, seen.seam_ratio(), account)


def _counted(atlas: Atlas, blocked: NDArray[np.bool_]) -> Array:
    """The area by which each baked texel counts in the pace: none where it never starts, or has."""
    worn = atlas.features.get(WEAR, np.zeros_like(atlas.area)).reshape(-1) > 0.5
    sound = atlas.covered.reshape(-1) & ~blocked & ~worn
    area = atlas.area.reshape(-1)
    return np.where(sound, area, 0) if sound.any() else area


def _paced(
    laid: _Laid,
    waves: _Waves,
    growth: Growth,
    timing: Timing | None,
    amount: float,
    stains: Sequence[float],
) -> tuple[Array, Array]:
    """Onset and rate, in the place of the maps that are laid."""
    onset, rate, *down = laid.waves
    pace = growth.pace if timing is None else pace_of(timing.onset)
    for rows in _chunks(onset.shape):
        part = slice(rows.start, rows.stop)
        late, slow = onset[part].copy(), rate[part]
        onset[part] = waves.arrivals.paced(late, pace, alike=0.0, amount=amount)
        if timing is None:
            rate[part] = np.exp(-growth.mottling * np.clip(0.6 - slow, 0, 2))
        else:
            rate[part] = waves.slowness.paced(slow, pace_of(timing.rate), alike=1.0)
        if down:
            sooner, stain = (each[part] for each in down)
            alone = waves.arrivals.paced(late + sooner, pace, alike=0.0, amount=amount)
            ends = np.interp(stain, np.linspace(0, 1, len(stains)), stains)
            rate[part] = _stained(onset[part], rate[part], alone, ends.astype(np.float32))
        onset[part][laid.never[part]] = 1
    return onset, rate


def _stained(onset: Array, rate: Array, alone: Array, ends: Array) -> Array:
    """The rate of what starts at `onset`, sooner than it would `alone`, as it is stained: it ends
    at the age at which its stain `ends`, or at that which it would have come to without, if later.
    """
    age = np.maximum(ends, rate * (1 - alone))
    slowed = (age / np.maximum(1 - onset, _LEAST)).clip(_LEAST, 1)
    return np.where(onset < alone, slowed, rate)


def _chunks(size: tuple[int, ...]) -> Iterator[range]:
    step = max(1, _CHUNK // size[1])
    for start in range(0, size[0], step):
        yield range(start, min(start + step, size[0]))
