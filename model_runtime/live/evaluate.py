"""What a live material shows: the sum that the shader does, slowly and plainly.

Imports no torch, so that Blender's side can use it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..maps import Pixels

__all__ = ("ROUGHNESS_MIN", "Curves", "LiveMaps")

ROUGHNESS_MIN = 0.01
"""The square root of the smallest alpha."""


@dataclass(frozen=True)
class Curves:
    """How a state y = (kd, ks, r), r = sqrt(alpha), follows from the one it started as:

        y(a) = G(a) y(0) + O(a) + sum_k c_k V_k(a),

    channel by channel, at T ages a from 0 to 1. At age 0 the gain is 1, the rest 0.

    gain, offset: [T, 7]
    shapes: [R, T, 7], one for each coefficient of a texel
    """

    gain: Pixels
    offset: Pixels
    shapes: Pixels

    def at(self, start: Pixels, coefficients: Pixels, age: Pixels) -> Pixels:
        """States [n, 7] of texels that were `start` [n, 7], with `coefficients` [n, R], at `age`
        [n] in 0..1; between two of the T ages in a straight line. At age 0 they are `start`.
        """
        gain, offset = _between(self.gain, age), _between(self.offset, age)
        state = gain * start + offset
        for coefficient, shape in zip(coefficients.T, self.shapes, strict=True):
            state += coefficient[:, None] * _between(shape, age)
        state[:, :6] = state[:, :6].clip(0)
        state[:, 6] = state[:, 6].clip(ROUGHNESS_MIN, 1)
        return np.where(age[:, None] > 0, state, start)

    def packed(self) -> Pixels:
        """As an image [3 (2 + R), T, 3], its first row on top: gain, offset and shapes in this
        order, each as three rows: kd, ks and (r, 0, 0).
        """
        curves = np.stack((self.gain, self.offset, *self.shapes))
        rows = np.zeros((len(curves), 3, *self.gain.shape[:1], 3), np.float32)
        rows[:, 0], rows[:, 1], rows[:, 2, :, 0] = curves[..., :3], curves[..., 3:6], curves[..., 6]
        return rows.reshape(-1, *rows.shape[2:])

    @classmethod
    def unpacked(cls, image: Pixels) -> Curves:
        """The curves that `packed` made `image` of."""
        kd, ks, r = (image[row::3] for row in range(3))
        gain, offset, *shapes = np.concatenate((kd, ks, r[..., :1]), -1)
        return cls(gain, offset, np.reshape(shapes, (-1, *gain.shape)))


@dataclass(frozen=True)
class LiveMaps:
    """A live material as its files hold it.

    timing: [H, W, 3] when a texel's history starts, how fast it runs and the age it has at once; or
        None, where its age is the time
    coefficients: [H, W, R]
    """

    curves: Curves
    timing: Pixels | None
    coefficients: Pixels

    def at(self, start: Pixels, time: float) -> Pixels:
        """States [H, W, 7] (kd, ks, r) at `time` in 0..1 of texels that were `start` [H, W, 7]."""
        size = start.shape[:2]
        age = np.full(size, time, np.float32)
        if self.timing is not None:
            onset, rate, given = np.moveaxis(self.timing, -1, 0)
            age = (given + rate * (age - onset).clip(0)).clip(0, 1)
        state = self.curves.at(
            start.reshape(-1, 7), self.coefficients.reshape(age.size, -1), age.reshape(-1)
        )
        return state.reshape(*size, 7)


def _between(curve: Pixels, age: Pixels) -> Pixels:
    """The values [n, 7] of a curve [T, 7] at `age` [n]."""
    place = age * np.float32(len(curve) - 1)
    lower = np.minimum(place.astype(np.int64), len(curve) - 2)
    share = (place - lower).astype(np.float32)[:, None]
    return curve[lower] * (1 - share) + curve[lower + 1] * share
