"""More of a texture, as a tile that wraps: patches of an example, cut where they differ least.

Image quilting (Efros and Freeman 2001) on a torus, from an example of any shape: only patches that
lie wholly in what may be used are taken, as large ones as most of it has room for. Each is the best
of some at random, those that were used often less likely, and is joined to its neighbors along the
path of least difference, feathered by a texel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .distance import Wraps, padded, smoothed

__all__ = ("quilted",)

Array = NDArray[np.float32]

_PATCHES = (96, 64, 48, 32, 24, 16, 12, 8)
_COVERED = 0.5  # share of the usable texels that patches of a size have to reach
_WHOLE = (1.0, 0.8, 0.5, 0.2, 0.01)  # share of a patch that is usable: all, where any fits
_OVERLAP = 3  # patches overlap by at least this part of their side, one over it
_TRIED = 160
_WORN = 1.0  # how much worse a patch counts for each time it was used
_FEATHER = 0.8
_COMPARED = 4  # components in which patches are compared


def quilted(example: Array, usable: NDArray[np.bool_], wraps: Wraps, side: int, seed: int) -> Array:
    """A tile [side, side, C] that wraps, of patches of `example` [H, W, C] where `usable` [H, W],
    which must hold at least one.
    """
    rng = np.random.default_rng(seed)
    patch, corners = _corners(usable, wraps, side)
    example = padded(example, patch, wraps)[patch:, patch:]
    canvas = _Canvas(
        np.zeros((side, side, example.shape[-1]), np.float32), np.zeros((side, side), bool)
    )
    compared = _components(example, usable)
    shown = _Canvas(np.zeros((side, side, compared.shape[-1]), np.float32), canvas.filled)
    used = np.zeros(len(corners))
    count = -(-side * _OVERLAP // (patch * (_OVERLAP - 1)))
    places = [round(k * side / count) for k in range(count)]
    for i, top in enumerate(places):
        for j, left in enumerate(places):
            tried = rng.choice(len(corners), min(_TRIED, len(corners)), replace=False)
            window = canvas.window(top, left, patch)
            known, before = canvas.filled[window], shown.pixels[window]
            costs = [
                np.square(_cut(compared, corners[k], patch) - before)[known].sum() for k in tried
            ]
            worth = (np.asarray(costs) + 1e-6) * (1 + _WORN * used[tried])
            best = tried[int(worth.argmin())]
            near = np.abs(corners - corners[best]).max(1) < patch // 2
            used[near] += 1
            seam = _seam(
                np.square(_cut(compared, corners[best], patch) - before).sum(-1),
                known,
                (i > 0, i == count - 1, j > 0, j == count - 1),
            )
            for target, source in ((canvas, example), (shown, compared)):
                target.pixels[window] += seam * (
                    _cut(source, corners[best], patch) - target.pixels[window]
                )
            canvas.filled[window] = True
    return canvas.pixels


@dataclass(frozen=True)
class _Canvas:
    pixels: Array
    filled: NDArray[np.bool_]

    def window(self, top: int, left: int, patch: int) -> tuple[NDArray, NDArray]:
        """The index of a patch, around the edges."""
        side = len(self.pixels)
        around = np.arange(patch)
        return (top + around[:, None]) % side, (left + around) % side


def _corners(usable: NDArray[np.bool_], wraps: Wraps, side: int) -> tuple[int, NDArray[np.int64]]:
    """The side of the patches, and the upper left corners [n, 2] of all that may be used."""
    total = int(usable.sum())
    for least in _WHOLE:
        found = 0, np.zeros((0, 2), np.int64)
        for patch in _PATCHES:
            if 2 * patch > min(side, *usable.shape) and patch > _PATCHES[-1]:
                continue
            sums = padded(usable.astype(np.int32), patch, wraps, fill=False)[patch:, patch:]
            for axis in (0, 1):
                sums = _windows(sums, patch, axis)
            whole = sums[: usable.shape[0], : usable.shape[1]] >= least * patch * patch
            if whole.any():
                found = patch, np.argwhere(whole)
            if _reached(whole, patch) >= _COVERED * total:
                break
        if len(found[1]):
            return found
    raise AssertionError("nothing may be used")


def _windows(values: NDArray[np.int32], length: int, axis: int) -> NDArray[np.int32]:
    """Sums over windows of `length` along `axis`, those that lie wholly inside."""
    width = [(1, 0) if each == axis else (0, 0) for each in (0, 1)]
    sums = np.moveaxis(np.cumsum(np.pad(values, width), axis), axis, 0)
    return np.moveaxis(sums[length:] - sums[:-length], 0, axis)


def _reached(whole: NDArray[np.bool_], patch: int) -> int:
    """How many texels the patches with these corners cover."""
    spread = np.pad(whole.astype(np.int32), patch - 1)
    for axis in (0, 1):
        spread = np.minimum(_windows(spread, patch, axis), 1)
    return int(spread.sum())


def _components(example: Array, usable: NDArray[np.bool_]) -> Array:
    """`example` [H, W, C] in the directions in which its usable texels differ most, each channel
    in its own standard deviations.
    """
    height, width = usable.shape
    some = example[:height, :width][usable]
    scale = np.maximum(some.std(0), 1e-6)
    axes = np.linalg.eigh(np.cov((some / scale).T))[1][:, ::-1][:, :_COMPARED]
    return ((example / scale) @ axes).astype(np.float32)


def _cut(pixels: Array, corner: NDArray[np.int64], patch: int) -> Array:
    top, left = corner
    return pixels[top : top + patch, left : left + patch]


def _seam(error: Array, known: NDArray[np.bool_], joined: tuple[bool, ...]) -> Array:
    """How much of the new patch shows, [P, P, 1]: all where nothing was `known`; elsewhere from a
    cut on through `error`, at each side (top, bottom, left, right) that is `joined`.
    """
    patch = len(error)
    shows = np.ones_like(error)
    for side, turns in zip(joined, (0, 2, 3, 1), strict=True):
        if side:  # turned so that the side lies on top
            turned, there = np.rot90(error, turns), np.rot90(known, turns)
            depth = int(np.argmin(there[:, patch // 2])) or patch // 2
            depth = min(max(depth, 2), patch // 2)
            path = _path(turned[:depth].T)
            below = np.ones((patch, patch), error.dtype)
            below[:depth] = np.arange(depth)[:, None] > path
            shows *= np.rot90(below, -turns)
    soft = smoothed(shows.astype(np.float32), _FEATHER, (False, False))
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
