"""The channels of a state, in the order in which every array of states holds them.

A state is what a texel is at one time: the Torrance-Sparrow parameters kd and ks (three colors
each) and alpha. Where states are shown rather than computed with, r = sqrt(alpha), Blender's
roughness, stands in alpha's place. From reading to writing states lie plane after plane, [C, n]
in memory; networks and fits read them row by row, [n, C].

Imports no torch, so that Blender's side can use it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import Tensor

__all__ = (
    "ALPHA",
    "ALPHA_MIN",
    "BOUNDS",
    "KD",
    "KS",
    "NAMES",
    "REFLECTANCES",
    "ROUGHNESS_MIN",
    "WIDTH",
    "clip_planes",
    "optics",
)

NAMES = ("kd_r", "kd_g", "kd_b", "ks_r", "ks_g", "ks_b", "alpha")
WIDTH = len(NAMES)

KD, KS, ALPHA = slice(0, 3), slice(3, 6), slice(6, 7)
REFLECTANCES = slice(0, 6)
"""kd and ks together."""

ALPHA_MIN = 1e-4
ROUGHNESS_MIN = math.sqrt(ALPHA_MIN)

BOUNDS: tuple[tuple[slice, float, float | None], ...] = (
    (REFLECTANCES, 0.0, None),
    (ALPHA, ALPHA_MIN, 1.0),
)
"""The least and the largest value that can be rendered, channels in their order."""

Array = TypeVar("Array", NDArray[np.float32], "Tensor")


def optics(states: Array) -> tuple[Array, Array, Array]:
    """(kd [..., 3], ks [..., 3], alpha [...]) of states [..., C]: views."""
    return states[..., KD], states[..., KS], states[..., ALPHA.start]


def clip_planes(planes: NDArray[np.float32], *, roughness: bool = False) -> None:
    """Bring `planes` [C, ...] within `BOUNDS`, in place; with `roughness` they hold r."""
    for channel, least, most in BOUNDS:
        if roughness and channel == ALPHA:
            least = ROUGHNESS_MIN
        np.clip(planes[channel], least, most, out=planes[channel])
