"""Tensors made of nothing, and the kinds of numbers they hold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .tensor import Array, Number, Tensor, array_of

__all__ = (
    "arange",
    "empty",
    "eye",
    "float16",
    "float32",
    "float64",
    "from_numpy",
    "full",
    "full_like",
    "half",
    "int8",
    "linspace",
    "long",
    "new_full",
    "new_tensor",
    "ones",
    "ones_like",
    "tensor",
    "uint8",
    "zeros",
    "zeros_like",
)

int8, uint8, float16, float32, float64 = map(np.dtype, ("i1", "u1", "f2", "f4", "f8"))
half, long = float16, np.dtype("i8")


def from_numpy(array: Array) -> Tensor:
    return Tensor(array)


def tensor(values: Any, *, dtype: np.dtype[Any] | None = None) -> Tensor:
    made = np.array(array_of(values), dtype)
    return Tensor(made.astype(float32) if dtype is None and made.dtype == float64 else made)


def zeros(*shape: Any, dtype: np.dtype[Any] = float32) -> Tensor:
    return Tensor(np.zeros(_shape(shape), dtype))


def ones(*shape: Any, dtype: np.dtype[Any] = float32) -> Tensor:
    return Tensor(np.ones(_shape(shape), dtype))


def empty(*shape: Any, dtype: np.dtype[Any] = float32) -> Tensor:
    return Tensor(np.empty(_shape(shape), dtype))


def full(shape: Sequence[int], value: Number) -> Tensor:
    return Tensor(np.full(shape, value, float32))


def eye(size: int) -> Tensor:
    return Tensor(np.eye(size, dtype=float32))


def zeros_like(x: Tensor, *, dtype: np.dtype[Any] | None = None) -> Tensor:
    return Tensor(np.zeros_like(x.array, dtype))


def ones_like(x: Tensor) -> Tensor:
    return Tensor(np.ones_like(x.array))


def full_like(x: Tensor, value: Number) -> Tensor:
    return Tensor(np.full_like(x.array, value))


def new_full(x: Tensor, shape: Sequence[int], value: Number) -> Tensor:
    return Tensor(np.full(shape, value, x.dtype))


def new_tensor(x: Tensor, values: Any) -> Tensor:
    return Tensor(np.array(values, x.dtype))


def arange(*ends: Number, dtype: np.dtype[Any] | None = None) -> Tensor:
    return tensor(np.arange(*ends), dtype=dtype)


def linspace(
    first: float, last: float, count: int, *, dtype: np.dtype[Any] = float32, device: Any = None
) -> Tensor:
    """In equal steps, exact at both ends."""
    return Tensor(np.linspace(first, last, count).astype(dtype))


def _shape(shape: tuple[Any, ...]) -> tuple[int, ...]:
    return shape[0] if len(shape) == 1 and not isinstance(shape[0], int) else shape
