"""Weathering sequences of our own: rust on steel, patina on copper, moss on stone and the others.

They are what the bundled models of change learn from, so a tile is no picture of one object: it is
a patchwork of many materials the process may meet (`weathering_materials`; each with variation
inside its patch), worn borders between them included, which together cover the initial values that
fitting targets will have, and no others. The histories are those of `kinetics`; nothing comes from
a data file.

Half of the texels, drawn at random, start at once (onset 0), so that histories are seen through to
a local age of 1; the others start when the process's onset map says. The sequence's `timing` is
that of the process's own maps.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model_runtime.channels import ALPHA, KD, KS
from model_runtime.errors import InputError
from model_runtime.model_files.card import MOST_AGES
from model_runtime.temporal.onset import fractal_noise, onset_map, rate_map
from model_runtime.temporal.pace import Timing

from .folder import MOST_TEXELS
from .kinetics import PROCESSES, history
from .sequences import Sequence, uniform_times
from .weathering_grain import GRAIN_SHARE, grain_strength, process_grain
from .weathering_materials import draw
from .writing import write_sequence

__all__ = ("generate", "initial_values", "write")

Array = NDArray[np.float32]
Rng = np.random.Generator

_SOURCE = "procedural (training/data/weathering.py)"
_PATCHES = 20  # patches along a side of the tile
_SAMPLED = 7  # texels of which one tells the means
_WORN = 0.35  # share of the patches that wear through to a neighbor
_NEVER_WORN = ("fading",)  # two dyes would blend to a gray, which has none to lose


def generate(process: str, *, size: int = 96, frames: int = 36, seed: int = 0) -> Sequence:
    """A weathering sequence of size x size texels at `frames` uniform times.

    `process` is one of `kinetics.PROCESSES`. The same arguments give the same sequence. Raises
    `InputError` for an unknown process, a size below 1, fewer than 2 frames, or more of either
    than `read_sequence` reads.
    """
    if process not in PROCESSES:
        raise InputError(
            f"There is no process named {process!r}.", f"Choose one of {', '.join(PROCESSES)}."
        )
    if not (size >= 1 and 2 <= frames <= MOST_AGES and frames * size * size <= MOST_TEXELS):
        raise InputError(
            f"A sequence cannot have {frames} frames of {size} x {size} texels.",
            f"Ask for 2 to {MOST_AGES:,} frames of at least 1 texel, {MOST_TEXELS:,} in all.",
        )
    rng = np.random.default_rng((seed, *process.encode()))
    first = kd, ks, alpha = initial_values(process, size=size, rng=rng)
    onset = onset_map(process, (size, size), seed=seed)
    timing = Timing.of(onset, rate_map(process, (size, size), seed=seed))
    onset[rng.random((size, size)) < 0.5] = 0.0

    times = uniform_times(frames)
    aged = [history(process, kd, ks, alpha, np.maximum(0, time - onset)) for time in times]
    kd, ks, alpha = (np.stack(maps) for maps in zip(*aged, strict=True))
    means = _means(process, first, times)
    return Sequence(
        kd, ks, alpha, times, onset, f"{process}-{seed}", timing,
        residue=process_grain(process, means[-1], seed=seed),
        strength=grain_strength(means),
        share=GRAIN_SHARE,
    )  # fmt: skip


def _means(process: str, first: tuple[Array, Array, Array], ages: Array) -> Array:
    """Mean kd, ks and r [T, 7] at `ages` [T] of materials that began as `first`."""
    kd, ks, alpha = (each.reshape(-1, *each.shape[2:])[::_SAMPLED] for each in first)
    means = []
    for age in ages:
        states = history(process, kd, ks, alpha, np.broadcast_to(age, alpha.shape))
        means.append(np.concatenate((states[0], states[1], np.sqrt(states[2])[:, None]), 1).mean(0))
    return np.stack(means).astype(np.float32)


def write(
    process: str, folder: Path, *, size: int = 96, frames: int = 36, seed: int = 0
) -> Sequence:
    """Generate a sequence and write it as a folder that `read_sequence` reads; returns it.

    Frames of an earlier sequence in that folder are replaced.

    Files: `kd_0001.exr ks_0001.exr alpha_0001.exr ...`, `onset.exr` and `sequence.json` (its times
    and how it was made). Raises `InputError` as `generate` does, `OutputError` where the folder
    cannot be written or holds frames that were not written so.
    """
    sequence = generate(process, size=size, frames=frames, seed=seed)
    made = {
        "process": process, "size": size, "frames": frames, "seed": seed,
        "source": _SOURCE, "license": "GPL-3.0-or-later",
    }  # fmt: skip
    write_sequence(sequence, folder, made)
    return sequence


def initial_values(process: str, *, size: int, rng: Rng) -> tuple[Array, Array, Array]:
    """A patchwork of materials before the process: Kd, Ks [size, size, 3], alpha [size, size]."""
    count = _PATCHES * _PATCHES
    materials = np.stack([draw(process, rng) for _ in range(count)]).astype(np.float32)
    patch, neighbor, border = _patches(size, rng)

    # Where patches wear through to the neighbor there are shares between two materials.
    worn = (rng.random(count) < (0 if process in _NEVER_WORN else _WORN))[patch]
    wear = fractal_noise(rng, (size, size), cells=(12, 12), gain=0.7) - 4.0 * border + 0.4
    share = np.where(worn, 1 / (1 + np.exp(-4.0 * wear)), 0.0)[..., None].astype(np.float32)
    values = materials[patch] * (1 - share) + materials[neighbor] * share

    # Variation inside a patch: lightness together, channels a little, roughness on its own.
    strength = rng.uniform(0.02, 0.35, count)[patch][..., None]
    grain = [
        fractal_noise(rng, (size, size), cells=(16, 16), gain=0.8) / 1.5
        + 0.5 * rng.standard_normal((size, size), np.float32)
        for _ in range(5)
    ]
    light, *channels, rough = (g[..., None] for g in grain)
    gain = np.exp(strength * (0.6 * light + 0.25 * np.concatenate(channels, -1)))
    ks = np.clip(values[..., KS] * gain, 0.0, 0.98)
    kd = np.clip(values[..., KD] * gain, 0.0, 0.95 * (1 - ks))
    alpha = np.clip(values[..., ALPHA] * np.exp(1.2 * strength * rough), 0.004, 1.0)
    return kd.astype(np.float32), ks.astype(np.float32), alpha[..., 0].astype(np.float32)


def _patches(size: int, rng: Rng) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Each texel's patch, the nearest other one, and how much nearer its own is, in patch widths.

    Voronoi cells of one jittered point per grid square, wrapping at the tile's edges.
    """
    n = _PATCHES
    jitter = rng.random((n, n, 2))
    texel = np.stack(np.meshgrid(*[(np.arange(size) + 0.5) * n / size] * 2, indexing="ij"), -1)
    home = texel.astype(np.int64)
    distances, owners = [], []
    for offset in np.ndindex(5, 5):
        at = home + np.array(offset) - 2
        row, column = (at % n)[..., 0], (at % n)[..., 1]
        point = at + jitter[row, column]
        distances.append(np.linalg.norm(texel - point, axis=-1))
        owners.append(row * n + column)
    distance, owner = np.stack(distances), np.stack(owners)
    order = np.argsort(distance, axis=0, kind="stable")[:2]
    near = np.take_along_axis(distance, order, 0)
    patch, neighbor = np.take_along_axis(owner, order, 0)
    return patch, neighbor, (near[1] - near[0]).astype(np.float32)
