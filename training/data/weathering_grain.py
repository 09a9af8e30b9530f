"""Grain of the processes that have formulas: what texels of one age differ in, drawn as noise.

No source shows it, so it is made to look plausible: lightness in octaves, a little hue, roughness
and relief that go with it. Where a surface cracks, ridges of the noise are the cracks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model_runtime.temporal.onset import fractal_noise

__all__ = ("GRAIN_SHARE", "grain_strength", "process_grain")

Array = NDArray[np.float32]

GRAIN_SHARE = 0.5
"""Of a material tile's side that a tile of this grain covers."""

_SIDE = 256


@dataclass(frozen=True)
class _Grain:
    """cells: of the first octave, (down, across); gain: from one octave to the next; light, hue:
    log-amplitudes; rough: amplitude in r; relief: in sides of the tile; cracks: how much of the
    lightness and relief is cracks
    """

    cells: tuple[float, float]
    gain: float
    light: float
    hue: float
    rough: float
    relief: float
    cracks: float = 0.0


_PROCESSES = {
    "rust": _Grain((10, 10), 0.8, 0.3, 0.12, 0.06, 0.002),
    "patina": _Grain((8, 10), 0.78, 0.2, 0.04, 0.05, 0.0012),
    "char": _Grain((10, 12), 0.7, 0.3, 0.03, 0.05, 0.006, cracks=0.7),
    "drying": _Grain((12, 12), 0.8, 0.06, 0.01, 0.02, 0.0005),
    "fading": _Grain((6, 6), 0.8, 0.05, 0.02, 0.02, 0.0),
    "soiling": _Grain((6, 10), 0.8, 0.22, 0.05, 0.03, 0.0005),
    "yellowing": _Grain((12, 12), 0.7, 0.05, 0.02, 0.01, 0.0003, cracks=0.5),
    "moss": _Grain((16, 16), 0.85, 0.3, 0.12, 0.03, 0.006),
}


def process_grain(process: str, mean: Array, *, seed: int = 0) -> Array:
    """What texels of `process` differ in when all is done, [256, 256, 8] in kd, ks, r and height,
    as a tile that wraps, around their `mean` [7] of kd, ks and r.
    """
    grain = _PROCESSES[process]
    rng = np.random.default_rng((seed, *process.encode()))
    shape = (_SIDE, _SIDE)
    light, hue, own = (
        _unit(fractal_noise(rng, shape, cells=grain.cells, gain=grain.gain)) for _ in range(3)
    )
    if grain.cracks:
        ridges = fractal_noise(rng, shape, cells=grain.cells, gain=0.45, count=3)
        cracks = -np.exp(-np.square(ridges / 0.12))
        light = _unit((1 - grain.cracks) * light + grain.cracks * 2 * cracks)
    tint = np.stack((hue, np.zeros_like(hue), -hue), -1)
    gain = np.exp(grain.light * light[..., None] + grain.hue * tint)
    residue = np.zeros((*shape, 8), np.float32)
    residue[..., :3] = mean[:3] * (gain - gain.mean((0, 1)))
    residue[..., 6] = grain.rough * (0.7 * own - 0.7 * light)
    residue[..., 7] = grain.relief * light
    return residue


def grain_strength(means: Array) -> Array:
    """[T]: how much of a process's last grain shows at ages at which its materials look like
    `means` [T, 7] (kd, ks and r): how far they are on the straight way to the last, rising.
    """
    seen = np.sqrt(np.maximum(means, 0))
    way = seen[-1] - seen[0]
    along = ((seen - seen[0]) @ way / max(float(way @ way), 1e-9)).clip(0, 1)
    return np.maximum.accumulate(along).astype(np.float32)


def _unit(noise: Array) -> Array:
    return (noise - noise.mean()) / max(float(noise.std()), 1e-9)
