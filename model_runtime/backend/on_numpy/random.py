"""Chance, number for number as PyTorch draws it: what is drawn decides what is looked at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .tensor import Tensor

__all__ = ("Generator", "randint", "randperm")


class Generator:
    """A Mersenne Twister."""

    def manual_seed(self, seed: int) -> Generator:
        self._state = np.random.RandomState(seed)
        return self

    def draw(self, count: int) -> np.ndarray:
        """`count` whole numbers below 2^32."""
        return self._state.randint(0, 1 << 32, count, np.uint32)


def randint(most: int, shape: Sequence[int], *, generator: Generator) -> Tensor:
    """Whole numbers from 0 to below `most`."""
    drawn = generator.draw(int(np.prod(shape))).astype(np.int64)
    return Tensor((drawn % most).reshape(shape))


def randperm(count: int, *, generator: Generator) -> Tensor:
    """The numbers below `count` in any order."""
    order = np.arange(count)
    left = np.arange(count, 1, -1)
    for place, further in enumerate(generator.draw(len(left)) % left):
        other = place + int(further)
        order[place], order[other] = order[other], order[place]
    return Tensor(order)
