"""What comes of many numbers: sums, the largest, orders. Every function is a method, too."""

from __future__ import annotations

from math import prod
from typing import Any, NamedTuple

import numpy as np

from .tensor import Tensor, floating, tensor_of

__all__ = (
    "all",
    "amax",
    "amin",
    "aminmax",
    "any",
    "argmax",
    "argmin",
    "argsort",
    "bincount",
    "cummax",
    "cumsum",
    "max",
    "mean",
    "median",
    "min",
    "norm",
    "searchsorted",
    "sum",
    "topk",
    "unique",
)

Dims = int | tuple[int, ...] | None


class Found(NamedTuple):
    """Numbers, and where they stood."""

    values: Tensor
    indices: Tensor


class Ends(NamedTuple):
    min: Tensor
    max: Tensor


def sum(x: Tensor, dim: Dims = None, keepdim: bool = False) -> Tensor:
    return tensor_of(np.sum(x.array, dim, keepdims=keepdim))


def mean(x: Tensor, dim: Dims = None, keepdim: bool = False) -> Tensor:
    dims = range(x.ndim) if dim is None else (dim,) if isinstance(dim, int) else dim
    count = prod(x.shape[each] for each in dims)  # of none, the mean is no number: nothing is said
    return tensor_of(np.sum(x.array, dim, keepdims=keepdim) / x.dtype.type(count))


def amax(x: Tensor, dim: Dims = None, keepdim: bool = False) -> Tensor:
    return tensor_of(np.max(x.array, dim, keepdims=keepdim))


def amin(x: Tensor, dim: Dims = None, keepdim: bool = False) -> Tensor:
    return tensor_of(np.min(x.array, dim, keepdims=keepdim))


def all(x: Tensor, dim: Dims = None, keepdim: bool = False) -> Tensor:
    return tensor_of(np.all(x.array, dim, keepdims=keepdim))


def any(x: Tensor, dim: Dims = None, keepdim: bool = False) -> Tensor:
    return tensor_of(np.any(x.array, dim, keepdims=keepdim))


def max(x: Tensor) -> Tensor:
    return amax(x)


def min(x: Tensor, dim: int | None = None) -> Any:
    """The least, or of each row along `dim` that and its place."""
    if dim is None:
        return amin(x)
    place = np.argmin(x.array, dim)
    least = np.take_along_axis(x.array, np.expand_dims(place, dim), dim)
    return Found(tensor_of(least.squeeze(dim)), tensor_of(place))


def aminmax(x: Tensor, *, dim: int | None = None) -> Ends:
    return Ends(amin(x, dim), amax(x, dim))


def argmax(x: Tensor, dim: int | None = None) -> Tensor:
    return tensor_of(np.argmax(x.array, dim))


def argmin(x: Tensor, dim: int | None = None) -> Tensor:
    return tensor_of(np.argmin(x.array, dim))


def argsort(x: Tensor, dim: int = -1) -> Tensor:
    return Tensor(np.argsort(x.array, dim))


def median(x: Tensor, dim: int, keepdim: bool = False) -> Found:
    """The lower of the two in the middle, where there are two."""
    middle = (x.shape[dim] - 1) // 2
    place = np.take(np.argpartition(x.array, middle, dim), [middle], dim)
    found = np.take_along_axis(x.array, place, dim)
    if not keepdim:
        found, place = found.squeeze(dim), place.squeeze(dim)
    return Found(tensor_of(found), tensor_of(place))


def topk(x: Tensor, k: int, *, largest: bool) -> Found:
    """The k least of each row, in their order."""
    assert not largest
    some = np.argpartition(x.array, np.minimum(k, x.shape[-1] - 1), -1)[..., :k]
    order = np.argsort(np.take_along_axis(x.array, some, -1), -1, kind="stable")
    place = np.take_along_axis(some, order, -1)
    return Found(Tensor(np.take_along_axis(x.array, place, -1)), Tensor(place))


def cumsum(x: Tensor, dim: int) -> Tensor:
    return Tensor(np.cumsum(x.array, dim))


def cummax(x: Tensor, dim: int) -> Found:
    assert dim == 0 and x.ndim == 1
    values = np.maximum.accumulate(x.array)
    return Found(Tensor(values), Tensor(np.searchsorted(values, values)))


def unique(x: Tensor) -> Tensor:
    return Tensor(np.unique(x.array))


def norm(x: Tensor, dim: Dims = None) -> Tensor:
    x = floating(x)
    return tensor_of(np.sqrt(np.sum(np.square(x.array), dim)))


def bincount(x: Tensor, minlength: int = 0) -> Tensor:
    return Tensor(np.bincount(x.array, minlength=minlength))


def searchsorted(sorted: Tensor, x: Tensor, *, right: bool = False) -> Tensor:
    return tensor_of(np.searchsorted(sorted.array, x.array, "right" if right else "left"))
