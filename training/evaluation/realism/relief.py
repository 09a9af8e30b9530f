"""Height across the border of what has weathered: what a chip's edge looks like from the side."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from ...source.distance import signed_distance, smoothed
from ..bench.results import Result

__all__ = ("BINS", "Profile", "compare_profiles", "profile", "weathered")

Array = NDArray[np.float32]

BINS = np.array((-40, -24, -16, -11, -8, -6, -4.5, -3, -1.5, 0, 1.5, 3, 5, 8, 12, 18, 26, 40))
"""Texels from the border, negative where it is clean."""

_FORM = 48.0  # texels: what is broader is the object's form
_SMOOTH = 1.5
_FEWEST = 32
_LIP = 0.03  # of the drop, that a lip is higher than what is clean


@dataclass(frozen=True)
class Profile(Result):
    """Mean height [B] by distance from the border, in shares of the drop, that of what is clean 0;
    NaN where hardly anything is that far.
    """

    JSON = (("height", 3), ("lip", 3))

    height: tuple[float, ...]

    @property
    def lip(self) -> float:
        """How much higher than what is clean it is at the most just before the drop."""
        before = np.array(self.height)[(BINS[1:] <= 0) & (BINS[:-1] >= -11)]
        return float(np.nanmax(before))


def weathered(picture: Array, clean: Array, gone: Array) -> NDArray[np.bool_]:
    """Which texels of a picture [H, W, 3] are nearer to the color `gone` than to `clean`."""
    way = gone - clean
    share = (picture - clean) @ way / (way @ way)
    return gaussian_filter(share, _SMOOTH, mode="wrap") > 0.5


def profile(height: Array, mask: NDArray[np.bool_], *, wraps: bool) -> Profile:
    """Of a map of heights [H, W] of any unit where `mask` [H, W] is weathered."""
    wrapped = (wraps, wraps)
    level = height - smoothed(height.astype(np.float32), _FORM, wrapped)
    distance = signed_distance(mask, wrapped, most=int(BINS[-1]) + 1)
    means = np.full(len(BINS) - 1, np.nan)
    for i, (low, high) in enumerate(itertools.pairwise(BINS)):
        some = level[(distance >= low) & (distance < high)]
        if len(some) >= _FEWEST:
            means[i] = some.mean()
    clean = np.nanmean(means[:2]) if np.isfinite(means[:2]).any() else np.nanmax(means)
    drop = max(float(clean - np.nanmin(means)), 1e-12)
    return Profile(tuple(((means - clean) / drop).tolist()))


def compare_profiles(first: Profile, second: Profile) -> tuple[float, bool]:
    """Correlation over the bins that both have, and whether `second` has a lip before its drop."""
    a, b = np.array(first.height), np.array(second.height)
    both = np.isfinite(a) & np.isfinite(b)
    alike = float(np.corrcoef(a[both], b[both])[0, 1]) if both.sum() > 2 else float("nan")
    return alike, second.lip > _LIP
