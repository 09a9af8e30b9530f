"""When each texel's history starts: seeded procedural patterns that spread like the real thing.

A model of change gives every texel the same history; what makes rust look like rust is that the
history starts at different times. An onset map holds that time, and the product ages a texel by

    a(x, y, t) = rate(x, y) max(0, t - onset(x, y)),

so that an onset of 0 and a rate of 1 everywhere are the paper's behaviour. The rate, at most 1,
mottles what has turned: no two places of a rusty plate are equally far.

The pattern is a growth process. Nuclei appear at random places and times (Johnson and Mehl 1939,
Avrami 1939) and spread through a medium of uneven speed; the arrival time T solves the eikonal
equation |grad T| = slowness on a coarse grid (Godunov's upwind scheme, Rouy and Tourin 1992), and
octaves of noise roughen its borders down to a few texels. Arrival times are then replaced by their
ranks, and the ranks by a pace, so that the same share of texels has started at a given time
whatever the seed and the size. How it spreads is the process's own; its pace, its mottling and its
scale are those of the source that a model learned from (`Timing`), where these are known. Where
they are not, the pace is `PACE` for what spreads, and a gentler one for what the sun or the air
does to a whole surface at once.

Everything is laid out in fractions of the tile's longer side and drawn per octave, so a small map
is the large one seen from further away.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .pace import Timing

__all__ = ("PACE", "fractal_noise", "onset_map", "rate_map")

Array = NDArray[np.float32]

PACE = ((0.0, 0.02), (0.06, 0.04), (0.30, 0.12), (0.76, 0.76), (1.0, 0.91))
"""(share of texels, time by which that share has started): a quick start, so that the first quarter
of the timeline already shows spots, a steady border in between, and a remnant that turns last."""

_EVERYWHERE = ((0.0, 0.005), (1.0, 0.12))  # nearly at once: a slight gradient
_SETTLING = ((0.0, 0.01), (0.85, 0.45), (1.0, 0.7))  # all over, sheltered places last
_EVAPORATING = ((0.0, 0.02), (0.06, 0.04), (0.30, 0.12), (0.95, 0.62), (1.0, 0.72))  # to the end

_GRID = 192  # cells of the coarse growth grid along the longer side
_ZOOM = (1 / 8, 4.0)  # smaller spots are lost on the grid, larger ones do not fit the tile
_LATE = 1e3  # an arrival time beyond any real one; finite, so that differences stay finite


@dataclass(frozen=True)
class _Growth:
    """How a process spreads. Lengths are in tile sides; time is what speed 1 needs to cross one."""

    nuclei: float  # per square tile
    clusters: tuple[float, float]  # noise cells (down, across) of the patches nuclei favour
    cluster_delay: float  # births lag by up to about this outside the patches
    birth_spread: float  # and by up to this at random
    across: float  # speeds
    down: float
    up: float
    unevenness: float  # log-amplitude of the slowness
    grain: tuple[float, float]  # noise cells (down, across) of the slowness and border noise
    raggedness: float  # amplitude of the border noise's first octave, in time
    gain: float  # amplitude ratio from one octave to the next finer one
    mottling: float  # log-amplitude by which histories run slower in places
    scale: float  # distance at which its onsets are half alike, where a tile holds many of them
    pace: tuple[tuple[float, float], ...] = PACE

    def zoomed(self, scale: float | None) -> _Growth:
        """The same pattern, magnified until its onsets are half alike at the distance `scale`."""
        if scale is None:
            return self
        zoom = min(max(scale / self.scale, _ZOOM[0]), _ZOOM[1])
        return replace(
            self,
            nuclei=self.nuclei / zoom**2,
            clusters=(self.clusters[0] / zoom, self.clusters[1] / zoom),
            grain=(self.grain[0] / zoom, self.grain[1] / zoom),
            across=self.across * zoom,
            down=self.down * zoom,
            up=self.up * zoom,
        )


_PROCESSES = {
    "rust": _Growth(
        nuclei=700, clusters=(3, 3), cluster_delay=0.08, birth_spread=0.06,
        across=1.0, down=1.5, up=0.9, unevenness=0.5, grain=(12, 12), raggedness=0.022, gain=0.82,
        mottling=0.5, scale=0.067,
    ),
    "patina": _Growth(
        nuclei=60, clusters=(3, 4), cluster_delay=0.6, birth_spread=0.2,
        across=0.35, down=1.3, up=0.2, unevenness=0.8, grain=(4, 16), raggedness=0.14, gain=0.72,
        mottling=0.35, scale=0.141,
    ),
    "char": _Growth(
        nuclei=5, clusters=(2, 2), cluster_delay=0.1, birth_spread=0.15,
        across=1.0, down=0.8, up=1.25, unevenness=1.0, grain=(9, 9), raggedness=0.06, gain=0.65,
        mottling=0.3, scale=0.169,
    ),
    "drying": _Growth(
        nuclei=30, clusters=(3, 3), cluster_delay=0.7, birth_spread=0.15,
        across=1.0, down=0.8, up=1.1, unevenness=0.9, grain=(7, 7), raggedness=0.09, gain=0.6,
        mottling=0.15, scale=0.305, pace=_EVAPORATING,
    ),
    "fading": _Growth(
        nuclei=3, clusters=(1, 1), cluster_delay=0.3, birth_spread=0.1,
        across=1.0, down=1.0, up=1.0, unevenness=0.2, grain=(2, 2), raggedness=0.03, gain=0.6,
        mottling=0.1, scale=0.305, pace=_EVERYWHERE,
    ),
    "soiling": _Growth(
        nuclei=260, clusters=(2, 10), cluster_delay=0.5, birth_spread=0.3,
        across=0.3, down=2.2, up=0.15, unevenness=0.7, grain=(3, 22), raggedness=0.12, gain=0.75,
        mottling=0.5, scale=0.104, pace=_SETTLING,
    ),
    "yellowing": _Growth(
        nuclei=3, clusters=(1, 1), cluster_delay=0.3, birth_spread=0.1,
        across=1.0, down=1.0, up=1.0, unevenness=0.3, grain=(3, 3), raggedness=0.04, gain=0.45,
        mottling=0.15, scale=0.304, pace=_EVERYWHERE,
    ),
    "moss": _Growth(
        nuclei=45, clusters=(3, 3), cluster_delay=0.35, birth_spread=0.2,
        across=1.0, down=1.0, up=1.0, unevenness=0.6, grain=(10, 10), raggedness=0.05, gain=0.8,
        mottling=0.35, scale=0.185,
    ),
}  # fmt: skip
_SPOTS = _Growth(
    nuclei=120, clusters=(3, 3), cluster_delay=0.15, birth_spread=0.1,
    across=1.0, down=1.0, up=1.0, unevenness=0.5, grain=(8, 8), raggedness=0.03, gain=0.55,
    mottling=0.3, scale=0.13,
)  # fmt: skip


def onset_map(
    process: str,
    shape: tuple[int, int],
    *,
    seed: int,
    timing: Timing | None = None,
    tileable: bool = True,
) -> Array:
    """Time, 0 to 1, at which each texel's history starts: float32 [H, W].

    `process` is `rust` (clustered spots that grow and merge), `patina` (streaks running down and
    soft patches), `char` (a ragged front burning outwards from a few places), `drying` (dry islands
    that eat into the wet), `soiling` (streaks below many sources), `moss` (cushions around a few
    dozen spores), `fading` and `yellowing` (nearly at once); any other name gets plain spots.
    `timing` sets the pace and the scale; None leaves both to the process.
    `tileable` patterns wrap at the edges without a seam; otherwise a burning front also enters from
    an edge. The same arguments give the same map.
    """
    height, width = shape
    assert min(shape) > 0, shape
    growth = _growth(process, timing)
    source = _Source(seed, zlib.crc32(process.encode()), height / max(shape), width / max(shape))
    arrival = _spline(_arrival(growth, source, process, tileable), shape, tileable)
    arrival += growth.raggedness * fractal_noise(
        source.rng("border"), shape, cells=growth.grain, gain=growth.gain, tileable=tileable
    )
    pace = growth.pace if timing is None else _quantiles(timing.onset)
    return _paced(arrival, pace, alike=0.0)


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
    growth = _growth(process, timing)
    source = _Source(seed, zlib.crc32(process.encode()), 1.0, 1.0)
    noise = fractal_noise(
        source.rng("rate"), shape, cells=growth.grain, gain=growth.gain, tileable=tileable
    )
    if timing is not None:
        return _paced(-noise, _quantiles(timing.rate), alike=1.0)
    return np.exp(-growth.mottling * np.clip(0.6 + noise, 0, 2), dtype=np.float32)


def _growth(process: str, timing: Timing | None) -> _Growth:
    growth = _PROCESSES.get(process, _SPOTS)
    return growth if timing is None else growth.zoomed(timing.scale)


def _quantiles(values: tuple[float, ...]) -> tuple[tuple[float, float], ...]:
    """As a pace: (share of texels, value)."""
    return tuple((k / (len(values) - 1), value) for k, value in enumerate(values))


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
    octaves: int | None = None,
    tileable: bool = True,
) -> Array:
    """Sum of octaves of smooth noise, roughly -1 to 1 in the first octave: float32 [H, W].

    `cells` counts the first octave's noise cells (down, across) on a tile with a side of 1; each
    octave doubles them and multiplies the amplitude by `gain`. Octaves end at cells of one texel,
    or after `octaves`. Coarse octaves are drawn first, so a larger map only adds detail.
    """
    height, width = shape
    longer = max(shape)
    total = np.zeros(shape, np.float32)
    amplitude, scale = 1.0, 1.0
    while octaves is None or octaves > 0:
        rows = max(1, round(cells[0] * scale * height / longer))
        columns = max(1, round(cells[1] * scale * width / longer))
        octave = rng.spawn(1)[0]
        if max(cells) * scale > longer and scale > 1.0:
            break
        lattice = octave.uniform(-1.7, 1.7, (rows, columns))
        total += np.float32(amplitude) * _spline(lattice, shape, tileable)
        amplitude, scale = amplitude * gain, scale * 2.0
        octaves = None if octaves is None else octaves - 1
    return total


def _spline(lattice: NDArray[np.floating], shape: tuple[int, int], tileable: bool) -> Array:
    """Cubic B-spline over a lattice of cell-centred values, by texel: float32 [H, W]."""
    values = lattice.astype(np.float32)
    for axis in (0, 1):
        cells, texels = values.shape[axis], shape[axis]
        # Where cells are only a few texels wide, a texel shows their average over its area.
        within = (0.25, 0.75) if 4 * cells > texels else (0.5,)
        result: Array | float = 0.0
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
                share = np.expand_dims(weight / len(within), 1 - axis)
                result = result + np.take(values, index, axis) * share
        values = np.asarray(result, np.float32)
    return values


def _arrival(growth: _Growth, source: _Source, process: str, tileable: bool) -> NDArray[np.float64]:
    """Arrival time of the growth on the coarse grid."""
    rows, columns = (max(8, round(_GRID * side)) for side in (source.height, source.width))
    shape = (rows, columns)
    patches = fractal_noise(
        source.rng("patches"), shape, cells=growth.clusters, octaves=3, tileable=tileable
    )
    uneven = fractal_noise(
        source.rng("slowness"), shape, cells=growth.grain, octaves=3, tileable=tileable
    )

    rng = source.rng("nuclei")
    count = max(3, round(growth.nuclei * source.height * source.width))
    y, x, late = rng.random((3, count))
    row, column = (y * rows).astype(np.int64), (x * columns).astype(np.int64)
    delay = 0.5 * growth.cluster_delay * (1.0 + patches[row, column])
    births = np.full(shape, _LATE)
    np.minimum.at(births, (row, column), delay + growth.birth_spread * late)
    if process == "char" and not tileable:
        births[-1] = growth.cluster_delay
    return _eikonal(births, np.exp(growth.unevenness * uneven) / _GRID, growth, tileable)


def _eikonal(
    births: NDArray[np.float64], step: NDArray[np.float64], growth: _Growth, tileable: bool
) -> NDArray[np.float64]:
    """First arrival from any birth; `step` is the time speed 1 needs to cross a cell."""

    def neighbour(times: NDArray[np.float64], shift: int, axis: int) -> NDArray[np.float64]:
        moved = np.roll(times, shift, axis)
        if not tileable:
            edge = [slice(None), slice(None)]
            edge[axis] = slice(0, 1) if shift > 0 else slice(-1, None)
            moved[tuple(edge)] = _LATE
        return moved

    times = births
    p = step / growth.across
    for _ in range(8 * _GRID):
        a = np.minimum(neighbour(times, 1, 1), neighbour(times, -1, 1))
        updated = times
        for shift, speed in ((1, growth.down), (-1, growth.up)):
            b, q = neighbour(times, shift, 0), step / speed
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


def _paced(arrival: Array, pace: tuple[tuple[float, float], ...], *, alike: float) -> Array:
    """Arrival times replaced by the `pace` of their ranks; by `alike` where they do not differ."""
    bins = 1 << 14
    low, high = float(arrival.min()), float(arrival.max())
    if high <= low:
        return np.full_like(arrival, alike)
    counts, edges = np.histogram(arrival, bins, (low, high))
    shares = np.concatenate(([0.0], np.cumsum(counts) / arrival.size))
    onset_at_edge = np.interp(shares, *np.transpose(pace))
    return np.interp(arrival, edges, onset_at_edge).astype(np.float32)
