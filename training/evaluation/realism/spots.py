"""Spots over time: how many, how much they cover and how long their borders are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter, label

from ...data.sequences import Sequence, uniform_times
from ...source.pictures import read_pictures

__all__ = (
    "LAPSES",
    "STATISTICS",
    "Lapse",
    "apart",
    "halves_of",
    "read_lapse",
    "spot_curves",
    "spread",
)

Array = NDArray[np.float32]

_FRAMES = 21
_CHANGED = 0.5
_SMOOTH = 1.0
_SMALLEST = 4  # texels; a smaller spot is noise
_ALPHA = 0.5
_DARKEST = 0.02  # darker than that a film tells no hue


@dataclass(frozen=True)
class Lapse:
    """process: of what happens; cuts: into halves that are alike, the first into the one that is
    learned from and the one that is met; filmed: whether they are photographs of a metal, whose
    brightness is what it reflects, or hold the diffuse albedo.
    """

    process: str
    cuts: tuple[tuple[str, str], ...]
    filmed: bool

    @property
    def learned(self) -> str:
        """The half that is learned from."""
        return self.cuts[0][0]

    @property
    def met(self) -> str:
        """The half that is to be met."""
        return self.cuts[0][1]

    def seen(self, pictures: Array) -> Array:
        """What of pictures [..., 3] (sRGB) tells spots: of photographs the hue alone."""
        if not self.filmed:
            return pictures
        told = np.log(np.maximum(pictures, _DARKEST))
        return told - told.mean(-1, keepdims=True)


_DOWN, _ACROSS = ("left", "right"), ("upper", "lower")

LAPSES: Mapping[str, Lapse] = {
    "SteelRusting": Lapse("rust", (_DOWN, _ACROSS), filmed=False),
    # A lamp's streak runs down the copper: no light of the left half is that of the right one.
    "copper_patinating": Lapse("patina", (_ACROSS,), filmed=True),
}
"""Real sequences."""

STATISTICS = ("number", "area", "perimeter")


def read_lapse(data: Path, name: str) -> Sequence:
    """A sequence's colors in at most 21 frames; nothing is known of gloss: none."""
    if name == "SteelRusting":
        files = sorted((data / "tvbtf" / name).glob("Kd-*.jpg"))
        frames = [_pixels(file) ** 2 for file in files]  # square-root encoded
    else:
        film = read_pictures(data / "timelapse" / f"{name}.webp")
        frames = list(film[np.rint(np.linspace(0, len(film) - 1, _FRAMES)).astype(int)])
    kd = np.stack(frames)
    alpha = np.full(kd.shape[:3], _ALPHA, np.float32)
    return Sequence(kd, np.zeros_like(kd), alpha, uniform_times(len(kd)), None, name)


def _pixels(file: Path) -> Array:
    with Image.open(file) as image:
        return np.asarray(image.convert("RGB"), np.float32) / 255


def halves_of(kd: Array) -> dict[str, Array]:
    """Left, right, upper and lower half of frames [T, H, W, 3]."""
    height, width = kd.shape[1:3]
    return {
        "left": kd[:, :, : width // 2],
        "right": kd[:, :, width // 2 :],
        "upper": kd[:, : height // 2],
        "lower": kd[:, height // 2 :],
    }


def spot_curves(seen: Array, first: Array, last: Array) -> Array:
    """[3, T]: spots in a million texels, the share that they cover, and length of border a texel,
    of frames [T, H, W, 3] as a lapse is `seen`, in which what is nearer to `last` [3] than to
    `first` counts as a spot.
    """
    way = last - first
    curves = []
    for frame in seen:
        share = (frame - first) @ way / (way @ way)
        spot = gaussian_filter(share, _SMOOTH) > _CHANGED
        places, count = cast(tuple[NDArray[np.int32], int], label(spot))
        sizes = np.bincount(places.ravel(), minlength=count + 1)[1:]
        border = sum(np.abs(np.diff(spot.astype(int), axis=axis)).sum() for axis in (0, 1))
        number = 1e6 * int((sizes >= _SMALLEST).sum()) / spot.size
        curves.append((number, float(spot.mean()), border / spot.size))
    return np.array(curves, np.float32).T


def apart(first: Array, second: Array) -> dict[str, float]:
    """By statistic, how far two sets of curves [3, T] are apart: the mean difference over time in
    shares of their mean.
    """
    return {
        name: float(np.abs(a - b).mean() / max((a + b).mean() / 2, 1e-6))
        for name, a, b in zip(STATISTICS, first, second, strict=True)
    }


def spread(curves: Mapping[str, Array], cuts: Iterable[tuple[str, str]]) -> dict[str, float]:
    """By statistic, how far the two halves of a sequence are apart, by whichever of the `cuts` it
    is more.
    """
    pairs = [apart(curves[first], curves[second]) for first, second in cuts]
    return {name: max(pair[name] for pair in pairs) for name in STATISTICS}
