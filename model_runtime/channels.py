"""The channels of a state, in the order in which every array of states holds them.

A state is what a texel is at one time: the Torrance-Sparrow parameters kd and ks (three colors
each) and alpha. Where states are shown rather than computed with, r = sqrt(alpha), Blender's
roughness, stands in alpha's place. From reading to writing states lie plane after plane, [C, n]
in memory; networks and fits read them row by row, [n, C].

Imports no torch, so that Blender's side can use it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .backend import Tensor

__all__ = (
    "ALPHA",
    "ALPHA_MIN",
    "CHANNELS",
    "FURTHER",
    "KD",
    "KS",
    "LOBE",
    "MOST_LOBES",
    "NAMES",
    "REFLECTANCES",
    "ROUGHNESS_MIN",
    "WIDTH",
    "Channel",
    "clip_planes",
    "lobe_maps",
    "optics",
)

ALPHA_MIN = 1e-4
ROUGHNESS_MIN = math.sqrt(ALPHA_MIN)


class Channel(NamedTuple):
    """Where a channel lies in a state, and the least and the largest value that can be rendered."""

    place: slice
    least: float
    most: float


CHANNELS = {
    "kd": Channel(slice(0, 3), 0.0, math.inf),
    "ks": Channel(slice(3, 6), 0.0, math.inf),
    "alpha": Channel(slice(6, 7), ALPHA_MIN, 1.0),
}
"""In their order, without gaps."""

KD, KS, ALPHA = (channel.place for channel in CHANNELS.values())
REFLECTANCES = slice(KD.start, KS.stop)
"""kd and ks together."""

NAMES = ("kd_r", "kd_g", "kd_b", "ks_r", "ks_g", "ks_b", "alpha")
"""Of every number of a state."""

WIDTH = len(NAMES)

LOBE = {"color": 3, "weight": 1, "alpha": 1}
"""What a lobe after the first is, and in how many channels: a metal, of a measured material."""

FURTHER = sum(LOBE.values())

_FURTHER_LOBES = ("second", "third")
MOST_LOBES = 1 + len(_FURTHER_LOBES)

Array = TypeVar("Array", NDArray[np.float32], "Tensor")


def optics(states: Array) -> tuple[Array, Array, Array]:
    """(kd [..., 3], ks [..., 3], alpha [...]) of states [..., C]: views."""
    return states[..., KD], states[..., KS], states[..., ALPHA.start]


def lobe_maps(lobes: int) -> dict[str, int]:
    """The maps of each of `lobes` after the first, and their channels."""
    return {
        f"{which}_{name}": channels
        for which in _FURTHER_LOBES[: lobes - 1]
        for name, channels in LOBE.items()
    }


def clip_planes(planes: NDArray[np.float32], *, roughness: bool = False) -> None:
    """Bring `planes` [C, ...] into range (`CHANNELS`), in place; with `roughness` they hold r."""
    for place, least, most in CHANNELS.values():
        least = ROUGHNESS_MIN if roughness and place == ALPHA else least
        np.clip(planes[place], least, most, out=planes[place])
