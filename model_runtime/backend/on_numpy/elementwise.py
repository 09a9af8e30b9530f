"""What is done with each number by itself. Every function is a method of tensors, too."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .tensor import Array, Number, Tensor, array_of, common, floating, tensor_of

__all__ = (
    "abs",
    "addcmul",
    "atan2",
    "clamp",
    "clamp_",
    "clamp_max",
    "clamp_min",
    "copy_",
    "cos",
    "div",
    "exp",
    "expm1",
    "fill_diagonal_",
    "floor",
    "hypot",
    "index_add_",
    "index_copy_",
    "isfinite",
    "lerp",
    "log",
    "log1p",
    "log10",
    "masked_fill",
    "minimum",
    "mul",
    "mul_",
    "pow",
    "power_of",
    "remainder",
    "round",
    "round_",
    "sigmoid",
    "sin",
    "sqrt",
    "square",
    "tanh",
    "where",
    "zero_",
)

_BLOCK = 1 << 14  # numbers at a time where one step follows another: they stay in the cache


def _each(function: Callable[..., Any]) -> Callable[[Tensor], Tensor]:
    """`function`, of numpy, of floats."""

    def applied(x: Tensor) -> Tensor:
        return tensor_of(function(floating(x).array))

    return applied


cos, exp, expm1, log, log10 = map(_each, (np.cos, np.exp, np.expm1, np.log, np.log10))
log1p, sin, sqrt, tanh = map(_each, (np.log1p, np.sin, np.sqrt, np.tanh))


def abs(x: Tensor) -> Tensor:
    return tensor_of(np.abs(x.array))


def floor(x: Tensor) -> Tensor:
    return tensor_of(np.floor(x.array))


def round(x: Tensor) -> Tensor:
    return tensor_of(np.rint(x.array))


def square(x: Tensor) -> Tensor:
    return tensor_of(np.square(x.array))


def isfinite(x: Tensor) -> Tensor:
    return tensor_of(np.isfinite(x.array))


def atan2(y: Tensor, x: Tensor) -> Tensor:
    return tensor_of(np.arctan2(*common(y.array, x)))


def hypot(x: Tensor, y: Tensor) -> Tensor:
    return tensor_of(np.hypot(*common(x.array, y)))


def minimum(x: Tensor, y: Tensor) -> Tensor:
    return tensor_of(np.minimum(*common(x.array, y)))


def remainder(x: Tensor, y: Tensor | Number) -> Tensor:
    return x % y


def mul(x: Tensor, y: Tensor | Number) -> Tensor:
    return x * y


def div(x: Tensor, y: Tensor | Number) -> Tensor:
    return x / y


def mul_(x: Tensor, y: Tensor | Number) -> Tensor:
    x *= y
    return x


def addcmul(x: Tensor, y: Tensor, z: Tensor) -> Tensor:
    return x + y * z


def lerp(start: Tensor, end: Tensor, weight: Tensor | Number) -> Tensor:
    """Between `start` and `end`; exact at both. Halves are computed with as single floats."""
    if start.array.dtype == np.float16:
        return _lerp_halves(start.array, end.array, np.asarray(array_of(weight)))
    share, first, last = _together(weight, start, end)
    away = last - first
    found = np.where(share < 0.5, first + share * away, last - (1 - share) * away)
    return tensor_of(found)


def _together(weight: Tensor | Number, *others: Tensor) -> tuple[Any, ...]:
    arrays = [each.array for each in others]
    dtype = np.result_type(*arrays)
    return tuple(np.asarray(array_of(each), dtype) for each in (weight, *arrays))


def _lerp_halves(start: Array, end: Array, share: Array) -> Tensor:
    """Of [C, n] with shares [n] or [], block after block."""
    found = np.empty(start.shape, np.float16)
    share = np.broadcast_to(share, start.shape[-1:])
    for first in range(0, start.shape[-1], _BLOCK):
        place = slice(first, first + _BLOCK)
        weight = share[place].astype(np.float32)
        for before, after, between in zip(start, end, found, strict=True):
            lower, upper = (each[place].astype(np.float32) for each in (before, after))
            upper -= lower
            upper *= weight
            upper += lower
            between[place] = upper
    return Tensor(found)


def pow(x: Tensor, power: Tensor | Number) -> Tensor:
    """Small whole powers are products."""
    array = x.array
    if not isinstance(power, int) or not 2 <= power <= 5:
        return tensor_of(np.power(*common(array, power)))
    found = np.square(array)
    if power >= 4:
        found *= found
    return tensor_of(found * array if power % 2 else found)


def power_of(power: Tensor, x: Number) -> Tensor:
    """x to this power."""
    exponent = floating(power).array
    return tensor_of(np.power(exponent.dtype.type(x), exponent))


def sigmoid(x: Tensor) -> Tensor:
    return Tensor(1 / (1 + np.exp(-x.array)))


def clamp(x: Tensor, least: Any = None, most: Any = None, *, max: Number | None = None) -> Tensor:
    most = most if max is None else max
    array = x.array
    if least is not None:
        array = np.maximum(*common(array, least))
    if most is not None:
        array = np.minimum(*common(array, most))
    return tensor_of(array)


def round_(x: Tensor) -> Tensor:
    np.rint(x.array, out=x.array)
    return x


def clamp_(x: Tensor, least: Number, most: Number) -> Tensor:
    return copy_(x, clamp(x, least, most))


def clamp_min(x: Tensor, least: Any) -> Tensor:
    return clamp(x, least)


def clamp_max(x: Tensor, most: Any) -> Tensor:
    return clamp(x, None, most)


def masked_fill(x: Tensor, mask: Tensor, value: Number) -> Tensor:
    return tensor_of(np.where(mask.array, x.array.dtype.type(value), x.array))


def where(condition: Tensor, x: Tensor | Number, y: Tensor | Number) -> Tensor:
    """Of two tensors, or of one and a number."""
    if isinstance(x, Tensor):
        first, second = common(x.array, y)
    else:
        assert isinstance(y, Tensor)
        second, first = common(y.array, x)
    return tensor_of(np.where(condition.array, first, second))


# In place, of use as methods.


def copy_(x: Tensor, source: Tensor) -> Tensor:
    x.array[...] = source.array
    return x


def zero_(x: Tensor) -> Tensor:
    x.array[...] = 0
    return x


def fill_diagonal_(x: Tensor, value: Number) -> Tensor:
    np.fill_diagonal(x.array, value)
    return x


def index_copy_(x: Tensor, dim: int, index: Tensor, source: Tensor) -> Tensor:
    assert dim == 0
    x.array[index.array] = source.array
    return x


def index_add_(x: Tensor, dim: int, index: Tensor, source: Tensor) -> Tensor:
    """Rows of `source` added where `index` says, one row of `x` as often as it is named."""
    assert dim == 0
    for column, added in zip(x.array.T, source.array.T, strict=True):
        column += np.bincount(index.array, added, len(column))
    return x
