"""The timing of an object's texels: when each starts to age and how fast it does, by its place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..temporal.pace import Timing
from ..temporal.processes import Growth, pace_of
from ..temporal.ranks import Ranking
from .arrivals import Asked, Waves, waves_of
from .atlas import MOST_KEPT, Atlas
from .exposure import BLOCKED, WEAR, Exposure
from .seams import Seen

__all__ = ("WHITE", "SurfaceTiming", "chunks", "surface_timing")

Array = NDArray[np.float32]

_CHUNK = 1 << 16  # texels of a step
_WORKERS = 2
_STAINS = (0.0, 0.1)
_LEAST = np.float32(1e-3)
_CURVE = np.linspace(0, 1, 11).round(1)  # times at which `aged.json` tells how much has started


WHITE = 0.999
"""Of what blocks: such texels never start."""


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
class _Laid:
    """Maps [H, W] of arrivals and mottling, and of what runs do where they do anything, [2 or 4, H,
    W], 0 where no face is; how both are ranked, by area; and what is blocked for good.
    """

    waves: Array
    arrivals: Ranking
    slowness: Ranking
    never: NDArray[np.bool_]

    @classmethod
    def of(
        cls, waves: Waves, atlas: Atlas, covered: NDArray[np.bool_], marks: Mapping[str, Array]
    ) -> _Laid:
        """Of the texels that are `covered`."""
        size = covered.shape[0], covered.shape[1]
        texel = atlas.spacing_at(size)
        arrivals, slowness = (Ranking(*range_) for range_ in waves.ranges(texel))
        pixels = np.zeros((waves.field.count, *size), np.float32)
        laid = cls(pixels, arrivals, slowness, np.zeros(size, bool))
        maps = pixels.reshape(len(pixels), -1)
        blocked = _blocked(atlas, marks)
        counted = _counted(atlas, blocked, marks)

        def lay(rows: range) -> tuple[Array, Array, Array]:
            """Arrivals and mottling of these rows, and the area of each texel."""
            places = atlas.places(covered, rows)
            found = waves.at(places, texel)
            maps[:, places.texel] = found
            laid.never.reshape(-1)[places.texel] = blocked.take(places.baked)
            return found[0], found[1], counted.take(places.baked)

        with ThreadPoolExecutor(_WORKERS) as workers:
            for late, slow, area in workers.map(lay, chunks(size)):
                arrivals.add(late, area)
                slowness.add(slow, area)
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
    marks: Mapping[str, Array] | None = None,
) -> SurfaceTiming:
    """The timing of a map of `size` of the surface that `atlas` shows.

    `marks` are maps [H, W] of the atlas's size, 0 to 1, by name (`MARKS`): what is worn starts at
    once, and the pace is that of the others; what is sought starts first, and what is blocked
    never. `pattern_size` is the distance in meters at which onsets are about half as alike as one
    is to itself; None: that of the process, on a surface of this area. An `amount` of the surface
    ever starts, 0 to 1. `timing` sets the pace, and the scale where no `pattern_size` does. Stains
    of ever more strength, in equal steps, end at the ages `stains`. It begins at the places
    `starts`, in meters of the world, before anywhere else. The same arguments give the same maps,
    and another size the same pattern.
    """
    marked = tuple((name, each.tobytes()) for name, each in sorted((marks or {}).items()))
    places = tuple(starts)
    asked = Asked(process, seed, exposure, timing, pattern_size, amount, places, marked)
    small = size[0] * size[1] <= MOST_KEPT
    found = (_timed if small else _timed.__wrapped__)(atlas, asked, size, tuple(stains))
    # What is kept is nobody's to change.
    return replace(found, onset=found.onset.copy(), rate=found.rate.copy()) if small else found


@lru_cache(maxsize=1)
def _timed(
    atlas: Atlas, asked: Asked, size: tuple[int, int], stains: tuple[float, ...]
) -> SurfaceTiming:
    """The timing that is `asked` for; the last is kept, as other settings change more often."""
    waves, marks = waves_of(atlas, asked), asked.marks(atlas.size)
    covered = atlas.covered_at(size)
    laid = _Laid.of(waves, atlas, covered, marks)
    onset, rate = _paced(laid, waves.growth, asked, stains)
    seen = Seen.of(atlas, onset)
    for rows in chunks(size):
        beside, source = atlas.beside(covered, rows)
        for pixels in (onset, rate):
            pixels.reshape(-1)[beside] = pixels.reshape(-1).take(source)
    account = {
        "maps": ["position", "normal", *sorted(atlas.features)],
        "points": len(waves.points),
        "area": round(float(waves.points.area.sum(dtype=np.float64)), 9),
        "pattern_size": round(waves.unit * waves.growth.scale, 9),
        "exposure": asked.exposure.json(),
        "started": dict(zip(map(str, _CURVE.tolist()), seen.share_below(_CURVE), strict=True)),
    }
    return SurfaceTiming(onset, rate, seen.seam_ratio(), account)


def _blocked(atlas: Atlas, marks: Mapping[str, Array]) -> NDArray[np.bool_]:
    """Which baked texels never start: [H W]."""
    known = marks.get(BLOCKED, atlas.features.get(BLOCKED))
    none = np.zeros(atlas.covered.size, bool)
    return none if known is None else known.reshape(-1) >= WHITE


def _counted(atlas: Atlas, blocked: NDArray[np.bool_], marks: Mapping[str, Array]) -> Array:
    """The area by which each baked texel counts in the pace: none where it never starts, or has."""
    worn = marks.get(WEAR, np.zeros_like(atlas.area)).reshape(-1) > 0.5
    sound = atlas.covered.reshape(-1) & ~blocked & ~worn
    area = atlas.area.reshape(-1)
    return np.where(sound, area, 0) if sound.any() else area


def _paced(
    laid: _Laid, growth: Growth, asked: Asked, stains: Sequence[float]
) -> tuple[Array, Array]:
    """Onset and rate, in the place of the maps that are laid."""
    onset, rate, *down = laid.waves
    timing, amount = asked.timing, asked.amount
    pace = growth.pace if timing is None else pace_of(timing.onset)
    for rows in chunks(onset.shape):
        part = slice(rows.start, rows.stop)
        late, slow = onset[part].copy(), rate[part]
        onset[part] = laid.arrivals.paced(late, pace, alike=0.0, amount=amount)
        if timing is None:
            rate[part] = np.exp(-growth.mottling * np.clip(0.6 - slow, 0, 2))
        else:
            rate[part] = laid.slowness.paced(slow, pace_of(timing.rate), alike=1.0)
        if down:
            sooner, stain = (each[part] for each in down)
            alone = laid.arrivals.paced(late + sooner, pace, alike=0.0, amount=amount)
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


def chunks(size: tuple[int, ...]) -> Iterator[range]:
    """The rows of a map of `size`, a few at a time."""
    step = max(1, _CHUNK // size[1])
    for start in range(0, size[0], step):
        yield range(start, min(start + step, size[0]))
