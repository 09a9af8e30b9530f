"""Statistics of textures, for histories that cannot agree texel by texel: where spots grow at other
places, a map is as good as it is distributed, and as it is patterned.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray

from model_runtime.states import perceptual

from ...source.onsets import radial_covariance

__all__ = ("autocorrelation_distance", "histogram_distance", "map_distances")

_LEVELS = 256
_FLAT = 1e-6


def histogram_distance(first: NDArray[np.floating], second: NDArray[np.floating]) -> float:
    """The area between the cumulative histograms of two maps [H, W] of any sizes: the mean way that
    values must move to turn one into the other (Wasserstein's first distance).
    """
    share = (np.arange(_LEVELS) + 0.5) / _LEVELS
    return float(np.abs(np.quantile(first, share) - np.quantile(second, share)).mean())


def autocorrelation_distance(first: NDArray[np.floating], second: NDArray[np.floating]) -> float:
    """Mean difference, over distances of up to a quarter of the shorter side, of how alike texels
    at that distance are in two maps [H, W] of one size.

    Alike is the covariance over all directions, divided by the larger of the two variances, so that
    a map that hardly varies is not like one that does, whatever its pattern. 0 to 2; 0 for equal
    maps, and for two without any variation.
    """
    a, b = radial_covariance(first), radial_covariance(second)
    larger = max(a[0], b[0])
    return 0.0 if larger < _FLAT else float(np.abs(a - b).mean() / larger)


def map_distances(truth: torch.Tensor, estimate: torch.Tensor) -> tuple[float, float]:
    """Histogram and autocorrelation distance of two textures [H, W, C], each the
    mean over the maps that the truth does not leave at 0; values are square roots, as the eye sees.
    """
    a, b = (perceptual(values, most=math.inf).numpy() for values in (truth, estimate))
    maps = [i for i in range(a.shape[-1]) if a[..., i].any() or b[..., i].any()]
    return (
        float(np.mean([histogram_distance(a[..., i], b[..., i]) for i in maps])),
        float(np.mean([autocorrelation_distance(a[..., i], b[..., i]) for i in maps])),
    )
