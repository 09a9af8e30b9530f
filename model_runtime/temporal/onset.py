"""When each texel's history starts: seeded procedural patterns that spread like the real thing.

A model of change gives every texel the same history; what makes rust look like rust is that the
history starts at different times. An onset map holds that time, and the product ages a texel by

    a(x, y, t) = rate(x, y) max(0, t - onset(x, y)),

so that an onset of 0 and a rate of 1 everywhere are the paper's behavior. The rate, at most 1,
mottles what has turned: no two places of a rusty plate are equally far.

The pattern is a growth process. Nuclei appear at random places and times (Johnson and Mehl 1939,
Avrami 1939) and spread through a medium of uneven speed; the arrival time T solves the eikonal
equation |grad T| = slowness on a coarse grid (Godunov's upwind scheme, Rouy and Tourin 1992), and
octaves of noise roughen its borders down to a few texels. Arrival times are then replaced by their
ranks, and the ranks by a pace, so that the same share of texels has started at a given time
whatever the seed and the size. How it spreads is the process's own; its pace, its mottling and its
scale, and how long and ragged its regions are, are those of the source that a model learned from
(`Timing`), where these are known. Where they are not, the pace is `PACE` for what spreads, and a
gentler one for what the sun or the air does to a whole surface at once.

Everything is laid out in fractions of the tile's longer side and drawn per octave, so a small map
is the large one seen from further away.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .pace import Timing
from .processes import Growth, Pace, growth_of, pace_of
from .ranks import Ranking
from .waves import Wave, octaves

__all__ = ("arrivals", "fractal_noise", "onset_map", "rate_map")

Array = NDArray[np.float32]

_GRID = 192  # cells of the coarse growth grid along the longer side
_LATE = 1e3  # an arrival time beyond any real one; finite, so that differences stay finite
_MOST_CELLS = 1024  # of a wave, where there are no more texels
_ROWS = 64  # of texels worked on at a time: what they need stays in the cache


def onset_map(
    process: str,
    shape: tuple[int, int],
    *,
    seed: int,
    timing: Timing | None = None,
    tileable: bool = True,
    worn: NDArray[np.bool_] | None = None,
) -> Array:
    """Time, 0 to 1, at which each texel's history starts: float32 [H, W].

    `process` is `rust` (clustered spots that grow and merge), `patina` (streaks running down and
    soft patches), `char` (a ragged front burning outwards from a few places), `drying` (dry islands
    that eat into the wet), `soiling` (streaks below many sources), `moss` (cushions around a few
    dozen spores), `fading` and `yellowing` (nearly at once); any other name gets plain spots.
    `timing` sets the pace and the scale; None leaves both to the process.
    `tileable` patterns wrap at the edges without a seam; otherwise a burning front also enters from
    an edge. What is `worn` [H, W] has begun already: it starts at once, the others around it
    sooner than elsewhere, and the pace is theirs. The same arguments give the same map.
    """
    height, width = shape
    assert min(shape) > 0, shape
    growth = growth_of(process, timing)
    source = _Source(seed, zlib.crc32(process.encode()), height / max(shape), width / max(shape))
    arrival = _spline(_arrival(growth, source, process, tileable, worn), shape, tileable)
    border = _noise(source.rng("border"), shape, growth.waves(), tileable)
    arrival += growth.raggedness * border
    pace = growth.pace if timing is None else pace_of(timing.onset)
    return _paced(arrival, pace, alike=0.0, worn=worn)


def rate_map(
    process: str,
    shape: tuple[int, int],
    *,
    seed: int,
    timing: Timing | None = None,
    tileable: bool = True,
) -> Array:
    """How fast each texel's history runs, above 0 and at most 1: float32 [H, W].

    Noise of the same grain as the border's, from a few texels up. The arguments are `onset_map`'s.
    """
    growth = growth_of(process, timing)
    source = _Source(seed, zlib.crc32(process.encode()), 1.0, 1.0)
    noise = fractal_noise(
        source.rng("rate"), shape, cells=growth.grain, gain=growth.gain, tileable=tileable
    )
    if timing is not None:
        return _paced(-noise, pace_of(timing.rate), alike=1.0)
    return np.exp(-growth.mottling * np.clip(0.6 + noise, 0, 2), dtype=np.float32)


@dataclass(frozen=True)
class _Source:
    """Random streams of one map, and the tile's extent in units of its longer side."""

    seed: int
    process: int
    height: float
    width: float

    def rng(self, purpose: str) -> np.random.Generator:
        words = (self.seed & (2**64 - 1), self.process, zlib.crc32(purpose.encode()))
        return np.random.default_rng(words)


def fractal_noise(
    rng: np.random.Generator,
    shape: tuple[int, int],
    *,
    cells: tuple[float, float],
    gain: float = 0.5,
    count: int | None = None,
    tileable: bool = True,
) -> Array:
    """Sum of octaves of smooth noise, roughly -1 to 1 in the first octave: float32 [H, W].

    `cells` counts the first octave's noise cells (down, across) on a tile with a side of 1; each
    octave doubles them and multiplies the amplitude by `gain`. Octaves end at cells of one texel,
    or after `count` of them. Coarse octaves are drawn first, so a larger map only adds detail.
    """
    return _noise(rng, shape, itertools.islice(octaves(cells, gain), count), tileable)


def _noise(
    rng: np.random.Generator, shape: tuple[int, int], waves: Iterable[Wave], tileable: bool
) -> Array:
    """Sum of `waves`, ever finer, down to cells of a texel: float32 [H, W]."""
    longer = max(shape)
    total = np.zeros(shape, np.float32, order="F")  # as `_spline` has it
    for k, wave in enumerate(waves):
        chance = rng.spawn(1)[0]  # also of the first that is not drawn: what follows depends on it
        if max(wave.down, wave.across) > longer and k > 0:
            break
        rows, columns = (
            max(1, min(round(cells * texels / longer), max(texels, _MOST_CELLS)))
            for cells, texels in zip(wave[:2], shape, strict=True)
        )
        lattice = chance.uniform(-1.7, 1.7, (rows, columns))
        total += np.float32(wave.height) * _spline(lattice, shape, tileable)
    return total


def arrivals(process: str, timing: Timing | None, *, seed: int) -> NDArray[np.float64]:
    """When growth alone, its border not yet ragged, arrives at the cells of a square tile that
    wraps: [G, G], in the time of a `Growth`.
    """
    source = _Source(seed, zlib.crc32(process.encode()), 1.0, 1.0)
    return _arrival(growth_of(process, timing), source, process, True, None)


def _spline(lattice: NDArray[np.floating], shape: tuple[int, int], tileable: bool) -> Array:
    """Cubic B-spline over a lattice of cell-centerd values, by texel: float32 [H, W]."""
    values = lattice.astype(np.float32)
    # Down, then across: each time along the first axis, where whole rows are taken.
    for texels in shape:
        values = _spline_down(values, texels, tileable).T
    return values


def _spline_down(values: Array, texels: int, tileable: bool) -> Array:
    """Along the first axis: [texels, W] of [cells, W]."""
    cells = len(values)
    # Where cells are only a few texels wide, a texel shows their average over its area.
    within = (0.25, 0.75) if 4 * cells > texels else (0.5,)
    taken: list[tuple[NDArray[np.int64], Array]] = []
    for place in within:
        position = (np.arange(texels) + place) * (cells / texels) - 0.5
        cell = np.floor(position).astype(np.int64)
        u = (position - cell).astype(np.float32)
        weights = (
            (1 - u) ** 3 / 6,
            (3 * u**3 - 6 * u**2 + 4) / 6,
            (-3 * u**3 + 3 * u**2 + 3 * u + 1) / 6,
            u**3 / 6,
        )
        for offset, weight in zip((-1, 0, 1, 2), weights, strict=True):
            index = cell + offset
            index = index % cells if tileable else np.clip(index, 0, cells - 1)
            taken.append((index, (weight / len(within))[:, None]))
    values = np.ascontiguousarray(values)
    result = np.zeros((texels, values.shape[1]), np.float32)
    for start in range(0, texels, _ROWS):
        rows = slice(start, start + _ROWS)
        for index, share in taken:
            term = values[index[rows]]
            term *= share[rows]
            result[rows] += term
    return result


def _arrival(
    growth: Growth,
    source: _Source,
    process: str,
    tileable: bool,
    worn: NDArray[np.bool_] | None,
) -> NDArray[np.float64]:
    """Arrival time of the growth on the coarse grid."""
    rows, columns = (max(8, round(_GRID * side)) for side in (source.height, source.width))
    shape = (rows, columns)
    patches = fractal_noise(
        source.rng("patches"), shape, cells=growth.clusters, count=3, tileable=tileable
    )
    uneven = fractal_noise(
        source.rng("slowness"), shape, cells=growth.grain, count=3, tileable=tileable
    )

    rng = source.rng("nuclei")
    count = max(3, round(growth.nuclei * source.height * source.width))
    y, x, late = rng.random((3, count))
    row, column = (y * rows).astype(np.int64), (x * columns).astype(np.int64)
    delay = 0.5 * growth.cluster_delay * (1.0 + patches[row, column])
    births = np.full(shape, _LATE)
    np.minimum.at(births, (row, column), delay + growth.birth_spread * late)
    if worn is not None:
        births[_any_in_cell(worn, shape)] = 0.0
    if process == "char" and not tileable:
        births[-1] = growth.cluster_delay
    return _eikonal(births, np.exp(growth.unevenness * uneven) / _GRID, growth, tileable)


def _eikonal(
    births: NDArray[np.float64], step: NDArray[np.float64], growth: Growth, tileable: bool
) -> NDArray[np.float64]:
    """First arrival from any birth; `step` is the time speed 1 needs to cross a cell."""

    def neighbor(times: NDArray[np.float64], shift: int, axis: int) -> NDArray[np.float64]:
        moved = np.roll(times, shift, axis)
        if not tileable:
            edge = [slice(None), slice(None)]
            edge[axis] = slice(0, 1) if shift > 0 else slice(-1, None)
            moved[tuple(edge)] = _LATE
        return moved

    times = births
    p = step / growth.across
    for _ in range(8 * _GRID):
        a = np.minimum(neighbor(times, 1, 1), neighbor(times, -1, 1))
        updated = times
        for shift, speed in ((1, growth.down), (-1, growth.up)):
            b, q = neighbor(times, shift, 0), step / speed
            # The larger root of ((T - a) / p)^2 + ((T - b) / q)^2 = 1, where it uses both sides.
            root = p * p + q * q - (a - b) ** 2
            both = (a * q * q + b * p * p + p * q * np.sqrt(np.maximum(root, 0.0))) / (
                p * p + q * q
            )
            one = np.minimum(a + p, b + q)
            usable = (root > 0.0) & (both >= np.maximum(a, b))
            updated = np.minimum(updated, np.where(usable, both, one))
        if np.array_equal(updated, times):
            break
        times = updated
    return times


def _any_in_cell(texels: NDArray[np.bool_], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Which cells of a grid of `shape` hold any of `texels` [H, W]."""
    found = np.zeros(shape, bool)
    row, column = np.nonzero(texels)
    height, width = texels.shape
    found[row * shape[0] // height, column * shape[1] // width] = True
    return found


def _paced(
    arrival: Array, pace: Pace, *, alike: float, worn: NDArray[np.bool_] | None = None
) -> Array:
    ranking = Ranking(float(arrival.min()), float(arrival.max()))
    if worn is None:
        ranking.add(arrival)
        return ranking.paced(arrival, pace, alike=alike)
    if not worn.all():
        ranking.add(arrival[~worn])
        return np.where(worn, np.float32(0), ranking.paced(arrival, pace, alike=alike))
    return np.zeros_like(arrival)
