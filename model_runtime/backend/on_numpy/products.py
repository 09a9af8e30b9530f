"""Products of matrices, and what is made of them."""

from __future__ import annotations

import importlib
from typing import NamedTuple

import numpy as np

from .tensor import Array, Tensor, common, tensor_of

__all__ = (
    "bmm",
    "cdist",
    "einsum",
    "linalg",
    "matmul",
    "tensordot",
)

_MANY = 25  # rows from which distances are told from products, as PyTorch does
_EXACT = "donot_use_mm_for_euclid_dist"


class Eigen(NamedTuple):
    values: Tensor
    vectors: Tensor


def has_library() -> bool:
    """Whether numpy has a library for products of matrices. PyPI's has, Blender's own has none."""
    built = importlib.import_module("numpy.__config__")
    if hasattr(built, "CONFIG"):
        return bool(built.CONFIG["Build Dependencies"]["blas"].get("found"))
    return bool(built.get_info("blas_opt"))  # of what was built by setup.py


def by_sums(a: Array, b: Array) -> Array:
    """a @ b, several times as fast as numpy's own product without a library."""
    return np.einsum("ij,jk->ik", a, b) if a.ndim == b.ndim == 2 else a @ b


times = np.matmul if has_library() else by_sums
"""The product of two arrays."""


def matmul(x: Tensor, y: Tensor) -> Tensor:
    a, b = common(x.array, y)
    if a.ndim > 2 and b.ndim == 2:  # one product instead of many small ones
        return Tensor(times(a.reshape(-1, a.shape[-1]), b).reshape(*a.shape[:-1], b.shape[1]))
    return tensor_of(times(a, b))


def bmm(x: Tensor, y: Tensor) -> Tensor:
    """[N, A, B] of [N, A, K] and [N, K, B]."""
    if x.shape[1] == 1:  # sums are faster than as many products of a row and a small matrix
        return Tensor(np.einsum("nk,nkb->nb", x.array[:, 0], y.array)[:, None])
    return Tensor(x.array @ y.array)


def tensordot(x: Tensor, y: Tensor, dims: int) -> Tensor:
    return Tensor(np.tensordot(*common(x.array, y), dims))


def einsum(equation: str, *operands: Tensor) -> Tensor:
    """As products of matrices, one operand after the other."""
    given, result = equation.split("->")
    labels, left = given.split(","), [each.array for each in operands]
    a, x = labels.pop(0), left.pop(0)
    while labels:
        b, y = labels.pop(0), left.pop(0)
        later = {*result, *"".join(labels)}
        kept = "".join(c for c in dict.fromkeys(a + b) if c in later) if labels else result
        x = _product(a, b, kept, *common(x, y))
        a = kept
    return tensor_of(x)


def _product(a: str, b: str, result: str, x: Array, y: Array) -> Array:
    """Both as [shared, own, summed] and [shared, summed, own], multiplied."""
    shared = [c for c in a if c in b and c in result]
    summed = [c for c in a if c in b and c not in result]
    own_a, own_b = ([c for c in each if c in result and c not in shared] for each in (a, b))
    size = dict(zip(a + b, x.shape + y.shape, strict=True))
    left = x.transpose([a.index(c) for c in (*shared, *own_a, *summed)])
    right = y.transpose([b.index(c) for c in (*shared, *summed, *own_b)])

    def count(labels: list[str]) -> int:
        return int(np.prod([size[c] for c in labels], dtype=int))

    n, i, k, j = map(count, (shared, own_a, summed, own_b))
    product = left.reshape(n, i, k) @ right.reshape(n, k, j)
    order = [*shared, *own_a, *own_b]
    return product.reshape([size[c] for c in order]).transpose([order.index(c) for c in result])


def cdist(x: Tensor, y: Tensor, *, compute_mode: str = "") -> Tensor:
    """Distances [N, K] of rows [N, D] and [K, D]."""
    a, b = x.array, y.array
    if compute_mode != _EXACT and max(len(a), len(b)) > _MANY:
        square = np.square(a).sum(1)[:, None] - 2 * (a @ b.T)
        square += np.square(b).sum(1)
        return Tensor(np.sqrt(np.maximum(square, 0, out=square), out=square))
    if len(b) < len(a):  # inner loops go over the longer list
        return cdist(y, x, compute_mode=_EXACT).T
    square = np.zeros((len(a), len(b)), a.dtype)
    away = np.empty_like(square)
    for of_a, of_b in zip(a.T, b.T, strict=True):
        np.subtract(of_a[:, None], of_b, out=away)
        square += np.square(away, out=away)
    return Tensor(np.sqrt(square, out=square))


class linalg:
    """As `torch.linalg`."""

    @staticmethod
    def solve(a: Tensor, b: Tensor) -> Tensor:
        return Tensor(np.linalg.solve(a.array, b.array))

    @staticmethod
    def eigh(x: Tensor) -> Eigen:
        values, vectors = np.linalg.eigh(x.array)
        return Eigen(Tensor(values), Tensor(vectors))
