"""The tensor: a numpy array that computes as PyTorch's tensors do.

What differs from numpy is which kind of number comes of two (`common`): numbers of Python and
tensors without dimensions never widen a tensor, and whole numbers become single floats.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ("Array", "Number", "Tensor", "array_of", "common", "device", "floating", "tensor_of")

Array = NDArray[Any]
Number = bool | int | float

_FLOAT = np.dtype(np.float32)
_RANK = {"b": 0, "u": 1, "i": 1, "f": 2}  # of kinds of numbers


@dataclass(frozen=True)
class device:
    """A place to compute on: "cpu", "cuda" or "cuda:1"."""

    name: str

    @property
    def type(self) -> str:
        return self.name.partition(":")[0]

    @property
    def index(self) -> int | None:
        number = self.name.partition(":")[2]
        return int(number) if number else None

    def __str__(self) -> str:
        return self.name


class Tensor:
    """`array` is what it holds; views of one array share it.

    The functions of `elementwise`, `shapes` and `reductions` are its methods, too.
    """

    __slots__ = ("array",)
    __array_priority__ = 1000  # of an array and a tensor comes a tensor

    def __init__(self, array: Array) -> None:
        self.array = array

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return self.array if dtype is None else self.array.astype(dtype, copy=bool(copy))

    def __repr__(self) -> str:
        return f"tensor({self.array!r})"

    # What it is.

    @property
    def shape(self) -> tuple[int, ...]:
        return self.array.shape

    @property
    def ndim(self) -> int:
        return self.array.ndim

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.array.dtype

    @property
    def device(self) -> device:
        return _CPU

    @property
    def T(self) -> Tensor:  # noqa: N802 - as PyTorch calls it
        return Tensor(self.array.T)

    @property
    def mT(self) -> Tensor:  # noqa: N802
        return Tensor(self.array.swapaxes(-1, -2))

    def dim(self) -> int:
        return self.array.ndim

    def numpy(self) -> Array:
        return self.array

    def tolist(self) -> Any:
        return self.array.tolist()

    def item(self) -> Any:
        return self.array.item()

    def __len__(self) -> int:
        return len(self.array)

    def __bool__(self) -> bool:
        return bool(self.array)

    def __int__(self) -> int:
        return int(self.array)

    def __float__(self) -> float:
        return float(self.array)

    __index__ = __int__
    __hash__ = object.__hash__

    # Its parts.

    def __iter__(self) -> Iterator[Tensor]:
        return (Tensor(np.asarray(each)) for each in self.array)

    def __getitem__(self, key: Any) -> Tensor:
        return Tensor(np.asarray(self.array[_key(key)]))

    def __setitem__(self, key: Any, value: Any) -> None:
        self.array[_key(key)] = array_of(value)

    # As another kind of number.

    def float(self) -> Tensor:
        return self._as(np.float32)

    def double(self) -> Tensor:
        return self._as(np.float64)

    def half(self) -> Tensor:
        return self._as(np.float16)

    def long(self) -> Tensor:
        return self._as(np.int64)

    def int(self) -> Tensor:
        return self._as(np.int32)

    def to(self, what: Any) -> Tensor:
        """As another kind of number; there is one device."""
        return self._as(what) if isinstance(what, np.dtype) else self

    def _as(self, dtype: Any) -> Tensor:
        return Tensor(self.array.astype(dtype, copy=False))

    def cpu(self) -> Tensor:
        return self

    def detach(self) -> Tensor:
        return self

    def clone(self) -> Tensor:
        return Tensor(self.array.copy("K"))

    def contiguous(self) -> Tensor:
        return Tensor(np.ascontiguousarray(self.array))

    # What comes of two.

    def __add__(self, other: Any) -> Tensor:
        return _two(np.add, self, other)

    def __sub__(self, other: Any) -> Tensor:
        return _two(np.subtract, self, other)

    def __rsub__(self, other: Any) -> Tensor:
        return _two(np.subtract, self, other, swapped=True)

    def __mul__(self, other: Any) -> Tensor:
        return _two(np.multiply, self, other)

    def __truediv__(self, other: Any) -> Tensor:
        return _two(_divide, self, other)

    def __rtruediv__(self, other: Any) -> Tensor:
        return _two(_divide, self, other, swapped=True)

    def __mod__(self, other: Any) -> Tensor:
        return _two(np.remainder, self, other)

    def __and__(self, other: Any) -> Tensor:
        return _two(np.bitwise_and, self, other)

    def __or__(self, other: Any) -> Tensor:
        return _two(np.bitwise_or, self, other)

    def __eq__(self, other: object) -> Tensor:  # type: ignore[override]
        return _two(np.equal, self, other)

    def __ne__(self, other: object) -> Tensor:  # type: ignore[override]
        return _two(np.not_equal, self, other)

    def __lt__(self, other: Any) -> Tensor:
        return _two(np.less, self, other)

    def __le__(self, other: Any) -> Tensor:
        return _two(np.less_equal, self, other)

    def __gt__(self, other: Any) -> Tensor:
        return _two(np.greater, self, other)

    def __ge__(self, other: Any) -> Tensor:
        return _two(np.greater_equal, self, other)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Tensor:
        return tensor_of(np.negative(self.array))

    def __invert__(self) -> Tensor:
        return tensor_of(np.invert(self.array))

    # Likewise, in place.

    def __iadd__(self, other: Any) -> Tensor:
        return self._change(operator.iadd, other)

    def __isub__(self, other: Any) -> Tensor:
        return self._change(operator.isub, other)

    def __imul__(self, other: Any) -> Tensor:
        return self._change(operator.imul, other)

    def __itruediv__(self, other: Any) -> Tensor:
        return self._change(operator.itruediv, other)

    def __ior__(self, other: Any) -> Tensor:
        return self._change(operator.ior, other)

    def _change(self, change: Callable[[Any, Any], Any], other: Any) -> Tensor:
        self.array = change(self.array, array_of(other))
        return self


_CPU = device("cpu")


def array_of(value: Any) -> Any:
    """The array of a tensor; anything else as it is."""
    return value.array if isinstance(value, Tensor) else value


def tensor_of(found: Any) -> Tensor:
    """What numpy returned, which is no array where it has no dimensions."""
    return Tensor(np.asarray(found))


def floating(value: Tensor) -> Tensor:
    """As floats: single ones of whole numbers."""
    return value if value.array.dtype.kind == "f" else value.float()


def common(a: Array, b: Any) -> tuple[Array, Any]:
    """Two operands as the kind of number that their result has."""
    b = array_of(b)
    if isinstance(b, bool | int | float):
        if isinstance(b, float) and a.dtype.kind != "f":
            a = a.astype(_FLOAT)
        elif not isinstance(b, bool) and a.dtype.kind == "b":
            a = a.astype(np.int64)
        return a, a.dtype.type(b)
    b = np.asarray(b)
    if a.dtype == b.dtype:
        return a, b
    dtype = _wider(a, b)
    return a.astype(dtype, copy=False), b.astype(dtype, copy=False)


def _wider(a: Array, b: Array) -> np.dtype[Any]:
    ranks = _RANK[a.dtype.kind], _RANK[b.dtype.kind]
    if ranks[0] != ranks[1]:
        return a.dtype if ranks[0] > ranks[1] else b.dtype
    if (a.ndim == 0) != (b.ndim == 0):
        return b.dtype if a.ndim == 0 else a.dtype
    return np.promote_types(a.dtype, b.dtype)


def _divide(a: Array, b: Any) -> Any:
    found = np.divide(a, b)
    return found if a.dtype.kind == "f" else found.astype(_FLOAT)


def _two(function: Callable[..., Any], a: Tensor, b: Any, *, swapped: bool = False) -> Any:
    if not isinstance(b, Tensor | bool | int | float | np.ndarray | np.generic):
        return NotImplemented
    left, right = common(a.array, b)
    return tensor_of(function(right, left) if swapped else function(left, right))


def _key(key: Any) -> Any:
    if isinstance(key, tuple):
        return tuple(array_of(each) for each in key)
    return array_of(key)
