"""What is in which place. Every function is a method of tensors, too."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .tensor import Tensor, tensor_of

__all__ = (
    "cartesian_prod",
    "cat",
    "expand",
    "expand_as",
    "flatten",
    "fliplr",
    "meshgrid",
    "movedim",
    "nonzero",
    "repeat",
    "reshape",
    "split",
    "stack",
    "transpose",
    "unbind",
    "unflatten",
)


def reshape(x: Tensor, *shape: Any) -> Tensor:
    return Tensor(x.array.reshape(*shape))


def flatten(x: Tensor, first: int = 0, last: int = -1) -> Tensor:
    first, last = first % x.ndim, last % x.ndim
    return Tensor(x.array.reshape(*x.shape[:first], -1, *x.shape[last + 1 :]))


def unflatten(x: Tensor, dim: int, sizes: Sequence[int]) -> Tensor:
    dim = dim % x.ndim
    return Tensor(x.array.reshape(*x.shape[:dim], *sizes, *x.shape[dim + 1 :]))


def transpose(x: Tensor, first: int, second: int) -> Tensor:
    return Tensor(x.array.swapaxes(first, second))


def movedim(x: Tensor, source: int, place: int) -> Tensor:
    return Tensor(np.moveaxis(x.array, source, place))


def fliplr(x: Tensor) -> Tensor:
    return Tensor(np.fliplr(x.array))


def expand(x: Tensor, *sizes: int) -> Tensor:
    """As often as `sizes` say, -1 for as it is; a view that is not to be written to."""
    own = (1,) * (len(sizes) - x.ndim) + x.shape
    shape = [mine if size == -1 else size for mine, size in zip(own, sizes, strict=True)]
    return Tensor(np.broadcast_to(x.array, shape))


def expand_as(x: Tensor, other: Tensor) -> Tensor:
    return Tensor(np.broadcast_to(x.array, other.shape))


def repeat(x: Tensor, *sizes: int) -> Tensor:
    return Tensor(np.tile(x.array, sizes))


def unbind(x: Tensor, dim: int = 0) -> tuple[Tensor, ...]:
    return tuple(tensor_of(each) for each in np.moveaxis(x.array, dim, 0))


def split(x: Tensor, sizes: int | Sequence[int], dim: int = 0) -> tuple[Tensor, ...]:
    """Parts of one size, the last one smaller; or of these `sizes`."""
    whole = isinstance(sizes, int)
    places = range(sizes, x.shape[dim], sizes) if whole else np.cumsum(sizes)[:-1]
    return tuple(map(Tensor, np.split(x.array, places, dim)))


def nonzero(x: Tensor) -> Tensor:
    return Tensor(np.argwhere(x.array))


def cat(tensors: Sequence[Tensor], dim: int = 0) -> Tensor:
    return Tensor(np.concatenate([each.array for each in tensors], dim))


def stack(tensors: Sequence[Tensor], dim: int = 0) -> Tensor:
    return Tensor(np.stack([each.array for each in tensors], dim))


def meshgrid(*axes: Tensor, indexing: str) -> tuple[Tensor, ...]:
    assert indexing == "ij"
    return tuple(map(Tensor, np.meshgrid(*(each.array for each in axes), indexing="ij")))


def cartesian_prod(*axes: Tensor) -> Tensor:
    """[N, A]: every combination of A lists, the last one changing fastest."""
    grids = np.meshgrid(*(each.array for each in axes), indexing="ij")
    return Tensor(np.stack(grids, -1).reshape(-1, len(axes)))
