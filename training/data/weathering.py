"""Weathering sequences of our own: rust on steel, patina on copper, charring wood.

They are what the bundled models of change learn from, so a tile is no picture of one object: it is
a patchwork of many materials the process may meet (each with variation inside its patch), worn
borders between them included, which together cover the initial values that targets will have. The
histories are those of `kinetics`; nothing comes from a data file.

Half of the texels, drawn at random, start at once (onset 0), so that histories are seen through to
a local age of 1; the others start when the process's onset map says.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model_runtime.errors import InputError, OutputError
from model_runtime.images import write_exr
from model_runtime.onset import fractal_noise, onset_map

from .kinetics import PROCESSES, history
from .sequences import Sequence, uniform_times

__all__ = ("generate", "initial_values", "write")

Array = NDArray[np.float32]
Rng = np.random.Generator

_PATCHES = 20  # patches along a side of the tile


def generate(process: str, *, size: int = 96, frames: int = 36, seed: int = 0) -> Sequence:
    """A weathering sequence of size x size texels at `frames` uniform times.

    `process` is one of `kinetics.PROCESSES`. The same arguments give the same sequence. Raises
    `InputError` for an unknown process, a size below 1 or fewer than 2 frames.
    """
    if process not in PROCESSES:
        raise InputError(
            f"There is no process named {process!r}.", f"Choose one of {', '.join(PROCESSES)}."
        )
    if size < 1 or frames < 2:
        raise InputError(
            f"A sequence cannot have {frames} frames of {size} x {size} texels.",
            "Ask for at least 2 frames of at least 1 texel.",
        )
    rng = np.random.default_rng((seed, *process.encode()))
    kd, ks, alpha = initial_values(process, size=size, rng=rng)
    onset = onset_map(process, (size, size), seed=seed)
    onset[rng.random((size, size)) < 0.5] = 0.0

    times = uniform_times(frames)
    aged = [history(process, kd, ks, alpha, np.maximum(0, time - onset)) for time in times]
    kd, ks, alpha = (np.stack(maps) for maps in zip(*aged, strict=True))
    return Sequence(kd, ks, alpha, times, onset, f"{process}-{seed}")


def write(
    process: str, folder: Path, *, size: int = 96, frames: int = 36, seed: int = 0
) -> Sequence:
    """Generate a sequence and write it as a folder that `read_sequence` reads; returns it.

    Frames of an earlier sequence in that folder are replaced.

    Files: `kd_0001.exr ks_0001.exr alpha_0001.exr ...`, `onset.exr` and `sequence.json` (its times
    and how it was made). Raises `InputError` as `generate` does, `OutputError` where the folder
    cannot be written.
    """
    sequence = generate(process, size=size, frames=frames, seed=seed)
    made = {
        "process": process, "size": size, "frames": frames, "seed": seed,
        "source": "procedural (training/data/weathering.py)", "license": "GPL-3.0-or-later",
        "times": [float(time) for time in sequence.times],
    }  # fmt: skip
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("kd", "ks", "alpha"):
            for earlier in folder.glob(f"{name}_*.exr"):
                earlier.unlink()
            for k, pixels in enumerate(getattr(sequence, name), start=1):
                write_exr(folder / f"{name}_{k:04d}.exr", pixels)
        assert sequence.onset is not None
        write_exr(folder / "onset.exr", sequence.onset)
        (folder / "sequence.json").write_text(json.dumps(made, indent=1), encoding="utf-8")
    except OSError as error:
        raise OutputError(
            f"The sequence cannot be written to {folder} ({error.strerror}).",
            "Choose a folder that can be written.",
        ) from error
    return sequence


def initial_values(process: str, *, size: int, rng: Rng) -> tuple[Array, Array, Array]:
    """A patchwork of materials before the process: Kd, Ks [size, size, 3], alpha [size, size]."""
    count = _PATCHES * _PATCHES
    materials = np.stack([_KINDS[process](rng) for _ in range(count)]).astype(np.float32)
    patch, neighbour, border = _patches(size, rng)

    # A third of the patches wears through to the neighbour: shares between two materials.
    worn = (rng.random(count) < 0.35)[patch]
    wear = fractal_noise(rng, (size, size), cells=(12, 12), gain=0.7) - 4.0 * border + 0.4
    share = np.where(worn, 1 / (1 + np.exp(-4.0 * wear)), 0.0)[..., None].astype(np.float32)
    values = materials[patch] * (1 - share) + materials[neighbour] * share

    # Variation inside a patch: lightness together, channels a little, roughness on its own.
    strength = rng.uniform(0.02, 0.35, count)[patch][..., None]
    grain = [
        fractal_noise(rng, (size, size), cells=(16, 16), gain=0.8) / 1.5
        + 0.5 * rng.standard_normal((size, size), np.float32)
        for _ in range(5)
    ]
    light, *channels, rough = (g[..., None] for g in grain)
    gain = np.exp(strength * (0.6 * light + 0.25 * np.concatenate(channels, -1)))
    kd = np.clip(values[..., 0:3] * gain, 0.0, 0.95)
    ks = np.clip(values[..., 3:6] * gain, 0.0, 0.98)
    alpha = np.clip(values[..., 6:7] * np.exp(1.2 * strength * rough), 0.004, 1.0)
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
    patch, neighbour = np.take_along_axis(owner, order, 0)
    return patch, neighbour, (near[1] - near[0]).astype(np.float32)


def _material(kd: Array, ks: ArrayLike, alpha: float) -> Array:
    return np.concatenate([kd, np.broadcast_to(ks, 3), [alpha]])


def _between(rng: Rng, low: float, high: float) -> float:
    """A number between two, even in its logarithm: widths and lightnesses are told apart so."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _hue(rng: Rng, saturation: float) -> Array:
    """A random colour of lightness 1 at its brightest channel; grey at saturation 0, pure at 1."""
    colour = rng.random(3) ** (4 * saturation)
    return colour / colour.max()


def _metal(rng: Rng, colour: Array, low: float, high: float) -> Array:
    """Bare metal: almost no Kd, Ks between `low` and `high` at its brightest channel."""
    tint = colour * np.exp(0.05 * rng.standard_normal(3))
    ks = tint / tint.max() * rng.uniform(low, high)
    return _material(ks * rng.uniform(0, 0.08), ks, _between(rng, 0.01, 0.7))


def _coat(rng: Rng, colour: Array, dullest: float = 0.8) -> Array:
    """Paint, lacquer or another dielectric over the given Kd."""
    return _material(colour, rng.uniform(0.015, 0.085), _between(rng, 0.01, dullest))


def _anything(rng: Rng) -> Array:
    """Whatever else a model may be tried on: plastics and metals of any colour."""
    colour = _hue(rng, 0.5 * rng.random())
    if rng.random() < 0.5:
        return _metal(rng, colour, 0.2, 0.95)
    return _coat(rng, colour * _between(rng, 0.05, 0.95), 1.0)


def _steel_like(rng: Rng) -> Array:
    kind = rng.random()
    if kind < 0.40:  # iron and steel, polished to mill finish; galvanised at the bright end
        return _metal(rng, np.array((1.0, 0.985, 0.965)), 0.25, 0.85)
    if kind < 0.78:  # painted steel, any hue, pale to dark
        return _coat(rng, _hue(rng, rng.random()) * _between(rng, 0.03, 0.9))
    if kind < 0.86:  # already rusty
        rust = np.array((0.25, 0.085, 0.026)) * _between(rng, 0.35, 1.3)
        return _coat(rng, rust, 1.0)
    return _anything(rng)


def _copper_like(rng: Rng) -> Array:
    kind = rng.random()
    if kind < 0.40:  # copper
        return _metal(rng, np.array((1.0, 0.62, 0.45)), 0.35, 0.97)
    if kind < 0.62:  # brass and bronze
        brass, bronze = np.array((1.0, 0.78, 0.38)), np.array((1.0, 0.70, 0.42))
        return _metal(rng, brass + (bronze - brass) * rng.random(), 0.3, 0.95)
    if kind < 0.80:  # tarnished: some of the colour has gone from Ks to Kd
        dull = _metal(rng, np.array((1.0, 0.6, 0.42)), 0.15, 0.5)
        dull[:3] += np.array((0.12, 0.05, 0.026)) * rng.random()
        return dull
    return _anything(rng)


def _wood_like(rng: Rng) -> Array:
    kind = rng.random()
    if kind < 0.62:  # woods, pale maple to wenge, raw to lacquered
        hue = np.array((1.0, rng.uniform(0.45, 0.8), 0.0))
        hue[2] = hue[1] * rng.uniform(0.35, 0.8)
        return _coat(rng, hue * _between(rng, 0.05, 0.75), 1.0)
    if kind < 0.78:  # leather, card, cloth
        return _coat(rng, _hue(rng, 0.6 * rng.random()) * _between(rng, 0.03, 0.8), 1.0)
    if kind < 0.90:  # painted wood
        return _coat(rng, _hue(rng, rng.random()) * _between(rng, 0.03, 0.9))
    return _anything(rng)


_KINDS: dict[str, Callable[[Rng], Array]] = {
    "rust": _steel_like,
    "patina": _copper_like,
    "char": _wood_like,
}
