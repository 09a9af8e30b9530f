"""More of a texture, as a tile that wraps: patches of an example, cut where they differ least.

Image quilting (Efros and Freeman 2001) on a torus, from an example of any shape: only patches that
lie wholly in what may be used are taken, as large ones as most of it has room for, and as elongated
as it is. Each is the best of some at random, those that were used often less likely, and is joined
to its neighbors along the path of least difference, feathered by a texel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .distance import Wraps, padded, smoothed

__all__ = ("quilted",)

Array = NDArray[np.float32]
Mask = NDArray[np.bool_]
Patch = tuple[int, int]

_SIDES = (96, 64, 48, 32, 24, 16, 12, 8)
_MOST_ELONGATED = 6.0
_LEAST_SIDE = 6
_COVERED = 0.4  # share of the usable texels that patches of a size have to reach
_WHOLE = (1.0, 0.8, 0.5, 0.2, 0.01)  # share of a patch that is usable: all, where any fits
_OVERLAP = 3  # patches overlap by at least this part of their side, one over it
_TRIED = 160
_WORN = 1.0  # how much worse a patch counts for each time it was used
_FEATHER = 0.8
_COMPARED = 4  # components in which patches are compared


def quilted(example: Array, usable: Mask, wraps: Wraps, side: int, seed: int) -> Array:
    """A tile [side, side, C] that wraps, of patches of `example` [H, W, C] where `usable` [H, W],
    which must hold at least one.
    """
    rng = np.random.default_rng(seed)
    patch, corners = _corners(usable, wraps, side)
    around = max(patch)
    example = padded(example, around, wraps)[around:, around:]
    compared = _components(example, usable)
    filled = np.zeros((side, side), bool)
    canvas, shown = (
        _Canvas(np.zeros((side, side, each.shape[-1]), np.float32), each, patch)
        for each in (example, compared)
    )
    used = np.zeros(len(corners))
    rows, columns = (_places(side, each) for each in patch)
    for i, top in enumerate(rows):
        for j, left in enumerate(columns):
            window = canvas.window(top, left)
            known, before = filled[window], shown.pixels[window]
            tried = rng.choice(len(corners), min(_TRIED, len(corners)), replace=False)
            costs = [np.square(shown.cut(corners[k]) - before)[known].sum() for k in tried]
            worth = (np.asarray(costs) + 1e-6) * (1 + _WORN * used[tried])
            best = corners[tried[int(worth.argmin())]]
            used[(2 * np.abs(corners - best) < patch).all(1)] += 1
            error = np.square(shown.cut(best) - before).sum(-1)
            ends = (i > 0, i == len(rows) - 1, j > 0, j == len(columns) - 1)
            seam = _seam(error, known, ends)
            for each in (canvas, shown):
                each.pixels[window] += seam * (each.cut(best) - each.pixels[window])
            filled[window] = True
    return canvas.pixels


@dataclass(frozen=True)
class _Canvas:
    """`pixels` that wrap, and what patches are cut from."""

    pixels: Array
    example: Array
    patch: Patch

    def window(self, top: int, left: int) -> tuple[NDArray, NDArray]:
        """The index of a patch, around the edges."""
        side = len(self.pixels)
        down, across = (np.arange(length) for length in self.patch)
        return (top + down[:, None]) % side, (left + across) % side

    def cut(self, corner: NDArray[np.int64]) -> Array:
        (top, left), (height, width) = corner, self.patch
        return self.example[top : top + height, left : left + width]


def _places(side: int, length: int) -> list[int]:
    """Where patches begin, evenly, so that they overlap."""
    count = -(-side * _OVERLAP // (length * (_OVERLAP - 1)))
    return [round(k * side / count) for k in range(count)]


def _corners(usable: Mask, wraps: Wraps, side: int) -> tuple[Patch, NDArray[np.int64]]:
    """The size of the patches, and the upper left corners [n, 2] of all that may be used."""
    total = int(usable.sum())
    patches = _sizes(usable, side)
    for least in _WHOLE:
        found = patches[-1], np.zeros((0, 2), np.int64)
        for patch in patches:
            around = max(patch)
            sums = padded(usable.astype(np.int32), around, wraps, fill=False)[around:, around:]
            for axis in (0, 1):
                sums = _windows(sums, patch[axis], axis)
            whole = sums[: usable.shape[0], : usable.shape[1]] >= least * patch[0] * patch[1]
            if whole.any():
                found = patch, np.argwhere(whole)
            if _reached(whole, patch) >= _COVERED * total:
                break
        if len(found[1]):
            return found
    raise AssertionError("nothing may be used")


def _sizes(usable: Mask, side: int) -> list[Patch]:
    """Heights and widths of patches to try, the largest first: as elongated as what may be used."""
    begins = [np.count_nonzero(usable & ~np.roll(usable, 1, axis)) + 1 for axis in (0, 1)]
    ratio = np.clip(begins[0] / begins[1], 1 / _MOST_ELONGATED, _MOST_ELONGATED) ** 0.5
    most = min(side, *usable.shape) // 2
    sizes = (
        (max(round(each / ratio), _LEAST_SIDE), max(round(each * ratio), _LEAST_SIDE))
        for each in _SIDES
    )
    return [each for each in sizes if max(each) <= most] or [(most, most)]


def _windows(values: NDArray[np.int32], length: int, axis: int) -> NDArray[np.int32]:
    """Sums over windows of `length` along `axis`, those that lie wholly inside."""
    width = [(1, 0) if each == axis else (0, 0) for each in (0, 1)]
    sums = np.moveaxis(np.cumsum(np.pad(values, width), axis), axis, 0)
    return np.moveaxis(sums[length:] - sums[:-length], 0, axis)


def _reached(whole: Mask, patch: Patch) -> int:
    """How many texels the patches with these corners cover."""
    spread = np.pad(whole.astype(np.int32), [(length - 1, length - 1) for length in patch])
    for axis in (0, 1):
        spread = np.minimum(_windows(spread, patch[axis], axis), 1)
    return int(spread.sum())


def _components(example: Array, usable: Mask) -> Array:
    """`example` [H, W, C] in the directions in which its usable texels differ most, each channel
    in its own standard deviations.
    """
    height, width = usable.shape
    some = example[:height, :width][usable]
    scale = np.maximum(some.std(0), 1e-6)
    axes = np.linalg.eigh(np.cov((some / scale).T))[1][:, ::-1][:, :_COMPARED]
    return ((example / scale) @ axes).astype(np.float32)


def _seam(error: Array, known: Mask, joined: tuple[bool, ...]) -> Array:
    """How much of the new patch shows, [h, w, 1]: all where nothing was `known`; elsewhere from a
    cut on through `error`, at each side (top, bottom, left, right) that is `joined`.
    """
    shows = np.ones_like(error)
    for side, turns in zip(joined, (0, 2, 3, 1), strict=True):
        if side:  # turned so that the side lies on top
            turned, there = np.rot90(error, turns), np.rot90(known, turns)
            most = max(2, len(turned) // 2)
            depth = min(max(int(np.argmin(there[:, there.shape[1] // 2])) or most, 2), most)
            path = _path(turned[:depth].T)
            below = np.ones(turned.shape, np.float32)
            below[:depth] = np.arange(depth)[:, None] > path
            shows *= np.rot90(below, -turns)
    soft = smoothed(shows, _FEATHER, (False, False))
    return np.where(known, soft, np.float32(1))[..., None]


def _path(error: Array) -> NDArray[np.int64]:
    """The path [n] of least error through [n, depth], a column a row, by steps of at most one."""
    total = error.copy()
    for row in range(1, len(total)):
        above = np.pad(total[row - 1], 1, constant_values=np.inf)
        total[row] += np.minimum(np.minimum(above[:-2], above[1:-1]), above[2:])
    path = np.empty(len(total), np.int64)
    path[-1] = total[-1].argmin()
    for row in range(len(total) - 2, -1, -1):
        low = max(path[row + 1] - 1, 0)
        path[row] = low + total[row, low : path[row + 1] + 2].argmin()
    return path
