"""What texels have beyond their mean history: a by-example texture of what weathered.

A source's texels differ from their mean by residues. Those of fully weathered ones, as a tile of
some components, are an example from which more of the like is drawn (Heitz and Neyret 2018,
"High-Performance By-Example Noise using a Histogram-Preserving Blending Operator"). How strong a
component is at which age, in which channels, its shapes say.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..channels import WIDTH
from . import by_example

__all__ = ("MOST_COMPONENTS", "MOST_TEXELS", "Grain", "share_of")

Array = NDArray[np.float32]
Halves = NDArray[np.float16]

MOST_COMPONENTS = 6
"""A live material shows them as coefficients, of which it has twelve."""

MOST_TEXELS = 1024
"""The largest side of a grain's tile."""

_LEVELS = 256
_LARGEST = {"table": 200.0, "shapes": 10.0}  # unit variance allows no more; reflectances are near 1


@dataclass(frozen=True)
class Grain:
    """An example of what texels have beyond their mean history, in K components, at most 6.

    tile: [K, S, S] uint8, S at most 1024, which wraps: 0 to 255 stand for Gaussian values -4 to 4,
        of zero mean and unit variance
    table: [K, 256], rising: what a component is where its Gaussian value is -4 to 4, evenly
        spaced, g of zero mean and unit variance
    shapes: [T, K, 8]: what a component of 1 adds at each of T ages from 0 to 1 to kd, ks, r =
        sqrt(alpha) and height (in sides of the tile); 0 at age 0
    share: which share of a material tile's side this one covers, above 0 and at most 1

    Raises ValueError for anything else.
    """

    tile: NDArray[np.uint8]
    table: Array
    shapes: Array
    share: float

    def __post_init__(self) -> None:
        count, side = (self.tile.shape[place] if self.tile.ndim else 0 for place in (0, -1))
        if (
            self.tile.dtype != np.uint8
            or self.tile.shape != (count, side, side)
            or not (1 <= count <= MOST_COMPONENTS and 1 <= side <= MOST_TEXELS)
        ):
            raise ValueError("the grain's tile is no square of bytes")
        if self.table.shape != (count, _LEVELS) or bool((np.diff(self.table) < 0).any()):
            raise ValueError("the grain's tables do not rise")
        if self.shapes.shape[1:] != (count, WIDTH + 1) or bool(self.shapes[:1].any()):
            raise ValueError("the grain's shapes do not start from nothing")
        for name, largest in _LARGEST.items():
            values = getattr(self, name)
            if values.dtype != np.float32 or not bool((np.abs(values) <= largest).all()):
                raise ValueError(f"the grain's {name} holds what no source has")
        if not 0 < self.share <= 1:
            raise ValueError("the grain's share is not between 0 and 1")

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What a model file holds of it, by name; its card has the `share`."""
        return {"grain.tile": self.tile, "grain.table": self.table, "grain.shapes": self.shapes}

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]], share: float) -> Grain:
        """What `arrays` made; KeyError where one is missing, ValueError where it cannot be used."""
        return cls(arrays["grain.tile"], arrays["grain.table"], arrays["grain.shapes"], share)

    def in_tile(self, size: tuple[int, int], seed: int) -> Halves:
        """Components [H W, K] of a map of `size` that wraps, a material tile to its longer side.

        A small map is the large one seen from further away; the same arguments give the same map.
        """
        return by_example.in_tile(self._example, size, self.share, seed).T

    def on_surface(
        self, position: Array, normal: Array, side: float, seed: int, *, texel: float | None = None
    ) -> Halves:
        """Components [n, K] at places of a surface: positions [n, 3] in meters, unit normals
        [n, 3], where this tile's side has the length `side` and texels are `texel` meters apart, by
        default as far as the tile's.

        Laid along the axes of space, so that they go on across seams: seen along the one that a
        face looks along, and blended between.
        """
        texel = side / self.tile.shape[-1] if texel is None else texel
        return by_example.on_surface(self._example, position, normal, side, seed, texel=texel).T

    @property
    def _example(self) -> by_example.Example:
        return by_example.Example(self.tile, self.table)


def share_of(card: Mapping[str, Any]) -> float:
    """`share` of a card's `grain`; ValueError where there is none."""
    stored = card.get("grain")
    share = stored.get("share") if isinstance(stored, dict) else None
    if isinstance(share, (int, float)) and not isinstance(share, bool):
        return float(share)
    raise ValueError("the card does not say which share of a tile its grain covers")
