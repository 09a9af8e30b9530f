"""What a live material shows: the sum that the shader does, slowly and plainly.

Imports no torch, so that Blender's side can use it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..brdf import principled
from ..channels import (
    ALPHA,
    FURTHER,
    KD,
    KS,
    LOBE,
    WIDTH,
    clip_planes,
    lobe_planes,
    optics,
    turning,
)
from ..contract import COEFFICIENTS_A_FILE
from ..maps import Pixels, PrincipledMaps, TorranceSparrowMaps

__all__ = (
    "BYTES",
    "HALVES",
    "Curves",
    "LiveMaps",
    "Packing",
    "packed_lobes",
    "unpacked_lobes",
)


@dataclass(frozen=True)
class Packing:
    """How coefficients lie in images, whose values are from 0 to 1: so many `in_each`; those of
    grain, which are 0 where `grain_zero` is, are that much less.
    """

    in_each: int
    grain_zero: float

    def unpacked(
        self, images: Sequence[Pixels], size: tuple[int, ...], count: int, grain: int
    ) -> Pixels:
        """The `count` coefficients [H, W, R] of `images` [H, W, 3 or more] of that `size`, the
        last `grain` of them grain.
        """
        channels = (image[..., : self.in_each] for image in images)
        found = np.concatenate((np.empty((*size, 0), np.float32), *channels), -1)[..., :count]
        found[..., count - grain :] -= np.float32(self.grain_zero)
        return found


BYTES = Packing(COEFFICIENTS_A_FILE, 128 / 255)
HALVES = Packing(3, 0.0)
"""That of floats, in results of earlier."""


@dataclass(frozen=True)
class Curves:
    """How a state y, r = sqrt(alpha) in alpha's place, follows from the one it started as:

        y(a) = G(a) y(0) + O(a) + sum_k c_k V_k(a),

    channel by channel, at T ages a from 0 to 1. At age 0 the gain is 1, the rest 0. After the
    channels of a state comes that of a height, which is 0 at age 0, gain or no gain.

    gain, offset: [T, C + 1]
    shapes: [R, T, C + 1], one for each coefficient of a texel
    """

    gain: Pixels
    offset: Pixels
    shapes: Pixels

    def at(self, start: Pixels, coefficients: Pixels, age: Pixels) -> Pixels:
        """States [n, C] of texels that were `start` [n, C], with `coefficients` [n, R], at `age`
        [n] in 0..1; between two of the T ages in a straight line. At age 0 they are `start`.
        """
        gain, offset = (_between(each[:, :WIDTH], age) for each in (self.gain, self.offset))
        state = gain * start + offset
        for coefficient, shape in zip(coefficients.T, self.shapes[..., :WIDTH], strict=True):
            state += coefficient[:, None] * _between(shape, age)
        clip_planes(state.T, roughness=True)
        return np.where(age[:, None] > 0, state, start)

    def heights(self, coefficients: Pixels, age: Pixels) -> Pixels:
        """Heights [n] of texels with `coefficients` [n, R] at `age` [n]; at age 0 they are 0."""
        height = _between(self.offset[:, WIDTH:], age)
        for coefficient, shape in zip(coefficients.T, self.shapes[..., WIDTH:], strict=True):
            height += coefficient[:, None] * _between(shape, age)
        return np.where(age > 0, height[:, 0], 0)

    def alone(self, start: Pixels) -> Curves:
        """Those that show what was `start` [C], whatever they are given: without a gain."""
        offset = self.offset.copy()
        offset[:, :WIDTH] += self.gain[:, :WIDTH] * start
        return Curves(np.zeros_like(self.gain), offset, self.shapes)

    def packed(self) -> Pixels:
        """As an image [3 (2 + R), T, 3], its first row on top: gain, offset and shapes in this
        order, each as three rows: kd, ks and (r, height, 0).
        """
        curves = np.stack((self.gain, self.offset, *self.shapes))
        rows = np.zeros((len(curves), 3, *self.gain.shape[:1], 3), np.float32)
        rows[:, 0], rows[:, 1], rows[:, 2, :, 0] = optics(curves)
        rows[:, 2, :, 1] = curves[..., WIDTH]
        return rows.reshape(-1, *rows.shape[2:])

    @classmethod
    def unpacked(cls, image: Pixels) -> Curves:
        """The curves that `packed` made `image` of."""
        curves = np.empty((len(image) // 3, image.shape[1], WIDTH + 1), np.float32)
        curves[..., KD], curves[..., KS] = image[::3], image[1::3]
        curves[..., ALPHA] = image[2::3, :, :1]
        curves[..., WIDTH] = image[2::3, :, 1]
        gain, offset, *shapes = curves
        return cls(gain, offset, np.reshape(shapes, (-1, *gain.shape)))


def packed_lobes(lobes: Pixels) -> Pixels:
    """Lobes after the first, [K, T, 8] with r in alpha's place at T ages from 0 to 1, as an image
    [3 K, T, 3]: each as three rows, its color, its edge and (weight, r, 0), the second lobe on top.
    """
    rows = np.zeros((len(lobes), lobes.shape[1], 9), np.float32)
    rows[..., :FURTHER] = lobes
    rows = rows.reshape(*rows.shape[:2], 3, 3).transpose(0, 2, 1, 3)
    return rows.reshape(-1, *rows.shape[2:])


def unpacked_lobes(image: Pixels) -> Pixels:
    """The lobes that `packed_lobes` made `image` of."""
    return np.concatenate((image[::3], image[1::3], image[2::3, :, :2]), -1)


@dataclass(frozen=True)
class LiveMaps:
    """A live material as its files hold it.

    timing: [H, W, 3] when a texel's history starts, how fast it runs and the age it has at once; or
        None, where its age is the time
    coefficients: [H, W, R]
    lobes: [K, T, 8] those after the first (`packed_lobes`), of a measured material; or None
    """

    curves: Curves
    timing: Pixels | None
    coefficients: Pixels
    lobes: Pixels | None = None

    def at(self, start: Pixels, time: float) -> Pixels:
        """States [H, W, C] at `time` in 0..1 of texels that were `start` [H, W, C]; with several
        lobes, whatever they were.
        """
        channels = start.shape[2]
        if self.lobes is not None:
            start = np.broadcast_to(self.curves.offset[0, :channels], start.shape)
        age = self._local(time)
        state = self.curves.at(
            start.reshape(-1, channels), self.coefficients.reshape(age.size, -1), age.reshape(-1)
        )
        return state.reshape(start.shape)

    def height(self, time: float) -> Pixels:
        """Heights [H, W] at `time`, in sides of the grain's tile."""
        age = self._local(time)
        flat = self.curves.heights(self.coefficients.reshape(age.size, -1), age.reshape(-1))
        return flat.reshape(age.shape)

    def further(self, time: float) -> dict[str, Pixels]:
        """The maps (`lobe_maps`) at `time` of lobes after the first."""
        if self.lobes is None:
            return {}
        age = self._local(time)
        now = np.stack([_between(lobe, age.reshape(-1)) for lobe in self.lobes], 1)
        now[..., LOBE["alpha"]] = np.square(now[..., LOBE["alpha"]])
        planes = lobe_planes(now, turning(self.lobes).any(1).tolist())
        return {name: _image(plane, age.shape) for name, plane in planes.items()}

    def _local(self, time: float) -> Pixels:
        """The age [H, W] of each texel at `time`."""
        age = np.full(self.coefficients.shape[:2], time, np.float32)
        if self.timing is not None:
            onset, rate, given = np.moveaxis(self.timing, -1, 0)
            age = (given + rate * (age - onset).clip(0)).clip(0, 1)
        return age

    def aged(self, authored: PrincipledMaps, time: float) -> TorranceSparrowMaps:
        """What texels that were `authored` show at `time`."""
        start = principled.forward(authored)
        given = np.concatenate((start.kd, start.ks, authored.roughness[..., None]), -1)
        kd, ks, r = optics(self.at(given, time).astype(np.float32, copy=False))
        return TorranceSparrowMaps(kd, ks, np.square(r))


def _image(plane: Pixels, size: tuple[int, ...]) -> Pixels:
    """[H, W, 3] of colors [H W, 3], [H, W] of numbers [H W, 1]."""
    shape = size if plane.shape[1] == 1 else (*size, plane.shape[1])
    return np.ascontiguousarray(plane.reshape(shape), np.float32)


def _between(curve: Pixels, age: Pixels) -> Pixels:
    """The values [n, C] of a curve [T, C] at `age` [n]."""
    place = age * np.float32(len(curve) - 1)
    lower = np.minimum(place.astype(np.int64), len(curve) - 2)
    share = (place - lower).astype(np.float32)[:, None]
    return curve[lower] * (1 - share) + curve[lower + 1] * share
