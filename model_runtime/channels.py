"""The channels of a state, in the order in which every array of states holds them.

A state is what a texel is at one time: the Torrance-Sparrow parameters kd and ks (three colors
each) and alpha. Where states are shown rather than computed with, r = sqrt(alpha), Blender's
roughness, stands in alpha's place. From reading to writing states lie plane after plane, [C, n]
in memory; networks and fits read them row by row, [n, C].

Imports no torch, so that Blender's side can use it.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Sequence
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
    "FURTHER_LOBES",
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
    "lobe_planes",
    "optics",
    "turning",
    "turning_in",
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

LOBE = {"color": slice(0, 3), "edge": slice(3, 6), "weight": slice(6, 7), "alpha": slice(7, 8)}
"""What a lobe after the first is, and where each lies among its numbers: a metal, of a measured
material, with the color that it has head-on and the one at the edge, where the view grazes it.
"""

FURTHER = LOBE["alpha"].stop

FURTHER_LOBES = ("second", "third")
MOST_LOBES = 1 + len(FURTHER_LOBES)

_TOLD_APART = 2.0**-11  # of colors: what half floats tell

Array = TypeVar("Array", NDArray[np.float32], "Tensor")


def optics(states: Array) -> tuple[Array, Array, Array]:
    """(kd [..., 3], ks [..., 3], alpha [...]) of states [..., C]: views."""
    return states[..., KD], states[..., KS], states[..., ALPHA.start]


def turning(lobes: Array) -> Array:
    """Of `lobes` [..., 8] after the first whether their color turns with the view: [...]."""
    apart = lobes[..., LOBE["edge"]] - lobes[..., LOBE["color"]]
    return (apart**2 > _TOLD_APART**2).any(-1)  # pyright: ignore[reportReturnType]


def turning_in(names: Container[str], lobes: int) -> list[bool]:
    """Of each of `lobes` after the first whether its edge is among the `names` of maps."""
    return [f"{which}_edge" in names for which in FURTHER_LOBES[: lobes - 1]]


def lobe_maps(turns: Sequence[bool]) -> dict[str, int]:
    """The maps of lobes after the first, and their channels: of one that `turns` that of its edge
    too, which in others has the same color.
    """
    return {name: place.stop - place.start for name, _, place in _parts(turns)}


def lobe_planes(lobes: Array, turns: Sequence[bool]) -> dict[str, Array]:
    """What `lobe_maps` hold of `lobes` [..., K, 8]: views [..., channels]."""
    return {name: lobes[..., k, place] for name, k, place in _parts(turns)}


def _parts(turns: Sequence[bool]) -> Iterator[tuple[str, int, slice]]:
    for k, (which, edge) in enumerate(zip(FURTHER_LOBES, turns, strict=False)):
        for name, place in LOBE.items():
            if edge or name != "edge":
                yield f"{which}_{name}", k, place


def clip_planes(planes: NDArray[np.float32], *, roughness: bool = False) -> None:
    """Bring `planes` [C, ...] into range (`CHANNELS`), in place; with `roughness` they hold r."""
    for place, least, most in CHANNELS.values():
        least = ROUGHNESS_MIN if roughness and place == ALPHA else least
        np.clip(planes[place], least, most, out=planes[place])
