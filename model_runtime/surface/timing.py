"""The timing of an object's texels: when each starts to age and how fast it does, by its place."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..temporal.pace import Timing
from ..temporal.processes import growth_of, pace_of
from ..temporal.ranks import Ranking
from .atlas import Atlas
from .exposure import Exposure, features
from .graph import join
from .growth import WEAR, Chance, grow, usual_unit
from .interpolation import Interpolation
from .noise import SpaceNoise
from .points import sample
from .runs import deposit
from .seams import Seen

__all__ = ("SurfaceTiming", "surface_timing")

Array = NDArray[np.float32]

_CHUNK = 1 << 16  # texels of a step
_WORKERS = 2
_COARSE = 4.0  # spacings of points: noise with cells longer than this is laid on them
_WHITE = 0.999  # of what blocks: such texels never start
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
) -> SurfaceTiming:
    """The timing of a map of `size` of the surface that `atlas` shows.

    What the atlas knows as worn starts at once, and the pace is that of the others.
    `pattern_size` is the distance in meters at which onsets are about half as alike as one is to
    itself; None: that of the process, on a surface of this area. An `amount` of the surface ever
    starts, 0 to 1. `timing` sets the pace, and the scale where no `pattern_size` does. The same
    arguments give the same maps, and another size the same pattern.
    """
    points = sample(atlas)
    graph = join(points)
    known = features(atlas, points, graph)
    total = float(points.area.sum(dtype=np.float64))
    unit = usual_unit(total)
    growth = growth_of(process, timing)
    if pattern_size is not None:
        growth = growth_of(process, None)
        unit = pattern_size / growth.scale
    chance = Chance(process, seed, unit)
    if exposure.runs:
        known["runs"] = deposit(
            points,
            graph,
            susceptibility=exposure.susceptibility(known),
            sky=known["sky"],
            unit=unit,
            rng=chance.rng("runs"),
        )
    arrival = grow(growth, points, graph, exposure=exposure, known=known, chance=chance)

    texel = atlas.spacing_at(size)
    border, mottling = (
        _Octaves.of(
            chance.noise(purpose, growth.grain, growth.gain), spacing=points.spacing, texel=texel
        )
        for purpose in ("border", "rate")
    )
    ragged = np.float32(growth.raggedness)
    long = arrival / ragged + border.long(points.position), -mottling.long(points.position)
    field = Interpolation.of(points, graph, np.stack(long, -1))
    onset_ranks, rate_ranks = Ranking(*border.range(long[0])), Ranking(*mottling.range(long[1]))
    covered = atlas.covered_at(size)
    onset, rate = np.zeros((2, *size), np.float32)
    never = np.zeros(size, bool)
    blocked = atlas.features.get("blocked", np.zeros_like(atlas.area)).reshape(-1) >= _WHITE
    worn = atlas.features.get(WEAR, np.zeros_like(atlas.area)).reshape(-1) > 0.5
    area = atlas.area.reshape(-1)
    if (sound := atlas.covered.reshape(-1) & ~blocked & ~worn).any():
        area = np.where(sound, area, 0)

    def lay(rows: range) -> tuple[Array, Array, Array]:
        """Arrivals and mottling of these rows, not yet ranked, and the area of each texel."""
        places = atlas.places(covered, rows)
        late, slow = field.at(places.position, points.at(places))
        late += border.short(places.position)
        slow -= mottling.short(places.position)
        onset.reshape(-1)[places.texel], rate.reshape(-1)[places.texel] = late, slow
        never.reshape(-1)[places.texel] = blocked.take(places.baked)
        return late, slow, area.take(places.baked)

    with ThreadPoolExecutor(_WORKERS) as workers:
        for late, slow, weight in workers.map(lay, _chunks(size)):
            onset_ranks.add(late, weight)
            rate_ranks.add(slow, weight)
    pace = growth.pace if timing is None else pace_of(timing.onset)
    for rows in _chunks(size):
        part = slice(rows.start, rows.stop)
        onset[part] = onset_ranks.paced(onset[part], pace, alike=0.0, amount=amount)
        onset[part][never[part]] = 1
        if timing is None:
            rate[part] = np.exp(-growth.mottling * np.clip(0.6 - rate[part], 0, 2))
        else:
            rate[part] = rate_ranks.paced(rate[part], pace_of(timing.rate), alike=1.0)
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


def _chunks(size: tuple[int, int]) -> Iterator[range]:
    step = max(1, _CHUNK // size[1])
    for start in range(0, size[0], step):
        yield range(start, min(start + step, size[0]))
