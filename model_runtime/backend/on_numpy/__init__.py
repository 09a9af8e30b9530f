"""What aging needs of PyTorch, over numpy: the same names, and the same numbers but for rounding.

There is one device, the CPU, and there are no gradients: what trains takes PyTorch itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from math import inf, nan, pi

import numpy as np
from numpy import finfo

from . import elementwise, making, nn, products, random, reductions, shapes
from .tensor import Tensor, device

__all__ = (
    "Tensor",
    "cuda",
    "device",
    "finfo",
    "inf",
    "inference_mode",
    "nan",
    "nn",
    "no_grad",
    "pi",
)

for _module in (elementwise, making, products, random, reductions, shapes):
    globals().update({name: getattr(_module, name) for name in _module.__all__})

_methods = {
    name: getattr(module, name)
    for module in (elementwise, reductions, shapes)
    for name in module.__all__
}
_methods |= {name: getattr(making, name) for name in ("new_full", "new_tensor")}
_methods |= {"__matmul__": products.matmul, "__pow__": _methods["pow"]}
_methods |= {"__rpow__": elementwise.power_of}
for _name, _function in _methods.items():
    setattr(Tensor, _name, _function)


@contextmanager
def inference_mode(mode: bool = True) -> Iterator[None]:
    """As PyTorch does, nothing is said where a number is too large or none."""
    with np.errstate(all="ignore" if mode else None):
        yield


no_grad = nullcontext


def get_num_threads() -> int:
    """Its own are numpy's affair."""
    return 1


def set_num_threads(count: int) -> None:
    """Likewise."""


class cuda:
    """There is none."""

    @staticmethod
    def is_available() -> bool:
        return False

    @staticmethod
    def device_count() -> int:
        return 0
