"""The cases of the report `synthesis`: what methods learn from, and what they are to reproduce."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter

from model_runtime.maps import TorranceSparrowMaps

from ...data.folder import Crop
from ...data.kinetics import history
from ...data.sequences import MixtureSequence, Sequence, read_sequence, uniform_times
from ...data.synthetic import S1_DELTA, from_pbr, offset, s1, s2

__all__ = ("CASES", "CORNERS", "GRID", "Case", "make_cases", "mixed_weights", "patches", "spots")

ALPHAS = (0.6, 0.8, 1.0)
BETAS = (0.0, 0.05, 0.1, 0.15, 0.2)
GRID = {
    f"{family}_a{a}_b{beta:g}": (family, a, beta)
    for family, a, beta in itertools.product(("s1", "s2"), ALPHAS, BETAS)
}
"""The cells of the paper's tables 1 and 2, by name."""

REAL: tuple[str, ...] = ("real_tvbtf45", "real_snowyground", "real_steelrusting")
CASES = (*GRID, "s3", "s4", *REAL)

PBR = ("Wood049", "Metal024", "Plastic005", "PaintedWood007B")
"""Materials of S1 and S2: metal, wood, paint and plastic, alpha 0.04 to 0.26; at most an eighth of
the values of a cell must be clamped."""

MIXTURES = (("alum-bronze", "dark-red-paint"), ("blue-acrylic", "pink-felt"))
"""Pairs of S3: measured materials that no bundled model was trained on."""

CORNERS = ((192, 192), (640, 576))
_FRAMES = 36
_STEEL = "Metal032"


@dataclass(frozen=True)
class Case:
    """One source and one target, whose first frame methods are given.

    name: of the cell it counts for; several materials may share it. material: which of them.
    source_key: the same where the source is, so that what was learned from it is used again.
    process: of the onset pattern that the product would choose.
    """

    name: str
    material: str
    source: Sequence | MixtureSequence
    target: Sequence | MixtureSequence
    source_key: str
    process: str = ""

    @property
    def key(self) -> str:
        """What it is called in files."""
        return f"{self.name}_{self.material}".replace(".", "")


def make_cases(data: Path, names: tuple[str, ...], *, size: int) -> Iterator[Case]:
    """The cases `names`, one after the other, their patches `size` texels wide; those that share a
    source follow each other.
    """
    for material, family, a in itertools.product(PBR, ("s1", "s2"), ALPHAS):
        wanted = [n for n in names if n in GRID and GRID[n][:2] == (family, a)]
        if not wanted:
            continue
        grow, delta = (s1, S1_DELTA) if family == "s1" else (s2, (0.0, 0.0, 0.0))
        source, target = patches(data / "pbr" / material, size)
        for name in wanted:
            start = offset(target, delta=delta, beta=GRID[name][2])
            key = f"{family}_a{a}_{material}".replace(".", "")
            yield Case(name, material, grow(source, a), grow(start, a), key)
    if "s3" in names:
        for pair in MIXTURES:
            source, target = (
                MixtureSequence(pair, mixed_weights(size, seed), uniform_times(_FRAMES), "S3")
                for seed in (1, 2)
            )
            yield Case("s3", "-".join(pair), source, target, f"s3_{'-'.join(pair)}")
    if "s4" in names:
        both = patches(data / "pbr" / _STEEL, size)
        source, target = (spots(patch, seed) for seed, patch in enumerate(both, start=1))
        yield Case("s4", _STEEL, source, target, f"s4_{_STEEL}", "rust")
    for name, read in _READERS.items():
        if name in names:
            left, right = _halves(read(data / "tvbtf"))
            yield Case(name, "right", left, right, name, _PROCESSES[name])


def patches(material: Path, size: int) -> tuple[TorranceSparrowMaps, TorranceSparrowMaps]:
    """Source and target of a material of ambientCG: patches apart from each other."""
    source, target = (
        from_pbr(material, (slice(y, y + size), slice(x, x + size))) for y, x in CORNERS
    )
    return source, target


def mixed_weights(size: int, seed: int) -> NDArray[np.float32]:
    """The weights of S3 [T, size, size]: w = sigmoid(6 (t - t0)), with t0 from -0.2 to 0.6, every
    value equally often, over smooth blotches. w(0) tells t0, so the first frame fixes the rest.
    """
    rng = np.random.default_rng((seed, 3))
    noise = gaussian_filter(rng.standard_normal((size, size)), size / 16, mode="wrap")
    rank = noise.ravel().argsort().argsort().reshape(size, size) / max(1, size * size - 1)
    time = uniform_times(_FRAMES)[:, None, None]
    return (1 / (1 + np.exp(-6 * (time - (0.8 * rank - 0.2))))).astype(np.float32)


def spots(initial: TorranceSparrowMaps, seed: int) -> Sequence:
    """S4: spots of rust that start at random places and times and grow at one speed (Avrami) over
    `initial`, steel; its onset [H, W] is when they arrive.

    The nuclei have nothing to do with what the steel looks like, so the first frame says nothing of
    where and when. Within a spot a texel follows the history of `kinetics`.
    """
    height, width = initial.size
    rng = np.random.default_rng((seed, 4))
    count = 24
    y, x, birth = rng.random(count) * height, rng.random(count) * width, 0.6 * rng.random(count)
    rows, columns = np.mgrid[:height, :width]
    distance = np.hypot(rows[..., None] + 0.5 - y, columns[..., None] + 0.5 - x)
    arrival = (birth + 2.5 * distance / max(height, width)).min(-1)
    onset = np.clip(arrival, 0, 1).astype(np.float32)
    times = uniform_times(_FRAMES)
    aged = [
        history("rust", initial.kd, initial.ks, initial.alpha, np.maximum(0, time - onset))
        for time in times
    ]
    kd, ks, alpha = (np.stack(maps) for maps in zip(*aged, strict=True))
    return Sequence(kd, ks, alpha, times, onset, "S4")


def _halves(sequence: Sequence) -> tuple[Sequence, Sequence]:
    """The left and the right half: no texel is in both."""
    middle = sequence.alpha.shape[2] // 2
    return _columns(sequence, slice(0, middle)), _columns(sequence, slice(middle, 2 * middle))


def _columns(sequence: Sequence, chosen: slice) -> Sequence:
    parts = {name: getattr(sequence, name)[:, :, chosen] for name in ("kd", "ks", "alpha")}
    return replace(sequence, **parts)


def _cast_iron(tvbtf: Path) -> Sequence:
    return _polynomials(tvbtf / "tvBTF45", (slice(80, 380), slice(80, 380)))


def _snow(tvbtf: Path) -> Sequence:
    """At half its resolution: 2 x 2 texels averaged."""
    whole = _polynomials(tvbtf / "SnowyGround", None)
    parts = {
        name: values.reshape(len(values), 256, 2, 256, 2, *values.shape[3:]).mean((2, 4))
        for name, values in vars(whole).items()
        if name in ("kd", "ks", "alpha")
    }
    return replace(whole, **parts)


def _polynomials(folder: Path, crop: Crop | None) -> Sequence:
    sequence = read_sequence(folder, frames=_FRAMES, crop=crop, clamp=False)
    assert isinstance(sequence, Sequence)
    return sequence


def _steel(tvbtf: Path) -> Sequence:
    """Diffuse photographs, square-root encoded; nothing is known of the gloss: none."""
    frames = [
        np.square(np.asarray(Image.open(path).convert("RGB"), np.float32) / 255)
        for path in sorted((tvbtf / "SteelRusting").glob("Kd-*.jpg"))
    ]
    kd = np.stack(frames)
    alpha = np.full(kd.shape[:3], 0.5, np.float32)
    return Sequence(kd, np.zeros_like(kd), alpha, uniform_times(len(kd)), None, "SteelRusting")


_READERS: dict[str, Callable[[Path], Sequence]] = dict(
    zip(REAL, (_cast_iron, _snow, _steel), strict=True)
)
_PROCESSES: dict[str, str] = dict(zip(REAL, ("rust", "", "rust"), strict=True))
