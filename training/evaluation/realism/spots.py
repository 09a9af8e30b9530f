"""Spots over time: how many, how much they cover and how long their borders are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter, label

from ...data.sequences import Sequence, uniform_times

__all__ = (
    "FILMED",
    "LAPSES",
    "STATISTICS",
    "apart",
    "halves_of",
    "read_lapse",
    "spot_curves",
    "spread",
)

Array = NDArray[np.float32]

LAPSES: Mapping[str, str] = {"SteelRusting": "rust", "copper_patinating": "patina"}
"""Real sequences, and the process of each."""

FILMED = ("copper_patinating",)
"""Those that are photographs of a metal; the others hold the diffuse albedo."""

STATISTICS = ("number", "area", "perimeter")

_FRAMES = 41
_CHANGED = 0.5
_SMOOTH = 1.0
_SMALLEST = 4  # texels; a smaller spot is noise
_ALPHA = 0.5


def read_lapse(data: Path, name: str) -> Sequence:
    """A sequence's colors in at most 41 frames; nothing is known of gloss: none."""
    if name == "SteelRusting":
        files = sorted((data / "tvbtf" / name).glob("Kd-*.jpg"))
        frames = [_pixels(Image.open(file)) ** 2 for file in files]  # square-root encoded
    else:
        with Image.open(data / "timelapse" / f"{name}.webp") as film:
            count: int = film.n_frames  # pyright: ignore[reportAttributeAccessIssue]
            frames = []
            for k in np.rint(np.linspace(0, count - 1, _FRAMES)).astype(int):
                film.seek(int(k))
                frames.append(_decoded(_pixels(film)))
    kd = np.stack(frames)
    alpha = np.full(kd.shape[:3], _ALPHA, np.float32)
    return Sequence(kd, np.zeros_like(kd), alpha, uniform_times(len(kd)), None, name)


def _pixels(image: Image.Image) -> Array:
    return np.asarray(image.convert("RGB"), np.float32) / 255


def _decoded(code: Array) -> Array:
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4).astype(
        np.float32
    )


def halves_of(kd: Array) -> dict[str, Array]:
    """Left, right, upper and lower half of frames [T, H, W, 3]."""
    height, width = kd.shape[1:3]
    return {
        "left": kd[:, :, : width // 2],
        "right": kd[:, :, width // 2 :],
        "upper": kd[:, : height // 2],
        "lower": kd[:, height // 2 :],
    }


def spot_curves(kd: Array, first: Array, last: Array) -> Array:
    """[3, T]: spots in a million texels, the share that they cover, and length of border a texel,
    of frames [T, H, W, 3] in which what is nearer to the color `last` [3] than to `first` counts as
    a spot.
    """
    start, way = np.sqrt(first), np.sqrt(last) - np.sqrt(first)
    curves = []
    for frame in kd:
        share = (np.sqrt(np.maximum(frame, 0)) - start) @ way / (way @ way)
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


def spread(curves: Mapping[str, Array]) -> dict[str, float]:
    """By statistic, how far the two halves of a sequence are apart, cut across or along, whichever
    is more.
    """
    pairs = (
        apart(curves["left"], curves["right"]),
        apart(curves["upper"], curves["lower"]),
    )
    return {name: max(pair[name] for pair in pairs) for name in STATISTICS}
