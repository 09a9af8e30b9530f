"""Distances on a grid of texels, to the nearest of some, across the edges of tiles that wrap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ("Wraps", "padded", "signed_distance", "smoothed")

Array = NDArray[np.float32]
Wraps = tuple[bool, bool]
"""Whether a tile goes on at its other side, (down, across)."""


def signed_distance(inside: NDArray[np.bool_], wraps: Wraps, *, most: int) -> Array:
    """Distance of each texel's center from the border of `inside` [H, W], in texels: positive
    inside, negative outside, at most `most` (> 0) each way. The border lies half way between
    texels, so that no distance is 0 and none between -0.5 and 0.5.
    """
    outward, inward = (_to_nearest(some, wraps, most) for some in (~inside, inside))
    return np.where(inside, outward, -inward) - np.where(inside, np.float32(0.5), np.float32(-0.5))


def _to_nearest(texels: NDArray[np.bool_], wraps: Wraps, most: int) -> Array:
    """Euclidean distance to the nearest of `texels` [H, W], at most `most` + 0.5: first down the
    columns, then the smallest of all steps across (Saito and Toriwaki 1994).
    """
    width = texels.shape[1]
    known = padded(texels, most, wraps, fill=False)
    down = np.full(known.shape, np.float32(most) + 1)
    down[known] = 0
    for row in range(1, len(down)):
        np.minimum(down[row], down[row - 1] + 1, out=down[row])
    for row in range(len(down) - 2, -1, -1):
        np.minimum(down[row], down[row + 1] + 1, out=down[row])
    square = np.square(down[most:-most])
    nearest = square[:, most : most + width].copy()
    for step in range(1, most + 1):
        for start in (most - step, most + step):
            np.minimum(nearest, square[:, start : start + width] + step * step, out=nearest)
    return np.minimum(np.sqrt(nearest), np.float32(most) + np.float32(0.5))


def smoothed(pixels: Array, sigma: float, wraps: Wraps) -> Array:
    """`pixels` [H, W] or [H, W, C] after a Gaussian of `sigma` texels."""
    reach = max(1, int(np.ceil(3 * sigma)))
    weights = np.exp(-0.5 * np.square(np.arange(-reach, reach + 1) / sigma)).astype(np.float32)
    weights /= weights.sum()
    for axis in (0, 1):
        length = pixels.shape[axis]
        index = np.arange(-reach, length + reach)
        index = index % length if wraps[axis] else index.clip(0, length - 1)
        total = np.zeros_like(pixels)
        for step, weight in enumerate(weights):
            total += weight * pixels.take(index[step : step + length], axis)
        pixels = total
    return pixels


def padded(
    pixels: NDArray, border: int, wraps: Wraps, *, fill: float | bool | None = None
) -> NDArray:
    """`pixels` [H, W, ...] with `border` texels more on each side: what lies beyond a tile that
    wraps, else `fill`, or where that is None the nearest texel.
    """
    for axis in (0, 1):
        width = [(0, 0)] * pixels.ndim
        width[axis] = (border, border)
        if wraps[axis]:
            pixels = np.pad(pixels, width, mode="wrap")
        elif fill is None:
            pixels = np.pad(pixels, width, mode="edge")
        else:
            pixels = np.pad(pixels, width, constant_values=fill)
    return pixels
