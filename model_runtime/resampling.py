"""Maps at another size: one rule, for all that make them. NumPy alone, so that Blender has it too.

A map repeats, as textures do unless told otherwise: beside its border lies what is at the other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ("any_within", "between", "resize")

Array = NDArray[np.float32]


def resize(pixels: Array, size: tuple[int, int]) -> Array:
    """Resample [H, W] or [H, W, C] to `size` = (height, width).

    Along an axis that shrinks, each new texel is the average of the area it covers; along one that
    grows, linear interpolation between texel centers (`between`).
    """
    for axis, length in enumerate(size):
        pixels = _resize_axis(pixels, axis, length)
    return np.ascontiguousarray(pixels)


def _resize_axis(pixels: Array, axis: int, length: int) -> Array:
    old = pixels.shape[axis]
    if length == old:
        return pixels
    index, weight = _area(old, length) if length < old else between(old, length)
    broadcast = [1] * pixels.ndim
    broadcast[axis] = length
    total = np.zeros((*pixels.shape[:axis], length, *pixels.shape[axis + 1 :]), np.float32)
    for sources, shares in zip(index, weight, strict=True):
        total += pixels.take(sources, axis) * shares.reshape(broadcast).astype(np.float32)
    return total


def _area(old: int, new: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Source texels and their shares, each [taps, new], of an average over old / new texels."""
    edges = np.arange(new + 1) * old / new
    first = np.floor(edges[:-1] + 1e-9).astype(np.intp)
    index = first + np.arange(int(np.ceil(old / new)) + 1)[:, None]
    overlap = np.minimum(index + 1, edges[1:]) - np.maximum(index, edges[:-1])
    weight = overlap.clip(0) * new / old
    used = weight.max(1) > 1e-9
    return index.clip(0, old - 1)[used], weight[used]


def between(old: int, new: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """The two of `old` texels between whose centers that of each of `new` lies, and their shares:
    [2, new] each.
    """
    place = (np.arange(new) + 0.5) * old / new - 0.5
    lower = np.floor(place).astype(np.intp)
    fraction = place - lower
    return np.stack((lower % old, (lower + 1) % old)), np.stack((1 - fraction, fraction))


def any_within(marked: NDArray[np.bool_], size: tuple[int, int]) -> NDArray[np.bool_]:
    """Which texels of a map of `size` have anything `marked` [H, W] in them; where it is larger,
    those that lie in a marked one.
    """
    for axis, length in enumerate(size):
        old = marked.shape[axis]
        if length >= old:
            marked = marked.take((np.arange(length) * 2 + 1) * old // (2 * length), axis)
            continue
        marked = np.logical_or.reduceat(marked, np.arange(length) * old // length, axis)
    return marked
