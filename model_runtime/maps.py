"""Materials as maps: what travels between reading, aging and writing.

Every map is a float32 array whose row 0 is the top row; one value throughout may be a broadcast
view. All maps of a material have one size, and 1 x 1 means a uniform material. Colors are linear
Rec.709.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from .channels import ALPHA, KD, KS, WIDTH

__all__ = ("HALF_MAX", "Bytes", "Halves", "Maps", "Pixels", "PrincipledMaps", "TorranceSparrowMaps")

Pixels = NDArray[np.float32]
Halves = NDArray[np.float16]
Bytes = NDArray[np.uint8]

HALF_MAX = 65504.0
"""The largest number that half floats hold, in which maps are written."""


class _SizedMaps:
    """What both kinds of maps share: one size, checked when they are made."""

    def __post_init__(self) -> None:
        size = self.size
        for field in fields(self):  # type: ignore[arg-type]
            pixels = getattr(self, field.name)
            assert pixels.dtype == np.float32, f"{field.name} is {pixels.dtype}"
            assert pixels.shape[:2] == size, f"{field.name} is {pixels.shape}, not {size}"

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) in texels."""
        first = getattr(self, fields(self)[0].name)  # type: ignore[arg-type]
        return first.shape[0], first.shape[1]

    def map(self, change: Callable[[Pixels], Pixels]) -> Self:
        """The same maps, each put through `change`."""
        return type(self)(*(change(getattr(self, field.name)) for field in fields(self)))  # type: ignore[arg-type]

    @property
    def uniform(self) -> bool:
        """One texel stands for the whole material."""
        return self.size == (1, 1)


@dataclass(frozen=True)
class TorranceSparrowMaps(_SizedMaps):
    """f = Kd / pi + Ks D G / (4 cos_i cos_o) per texel (docs/design.md, Conventions).

    kd:     [H, W, 3] diffuse albedo
    ks:     [H, W, 3] specular strength, flat Fresnel
    alpha:  [H, W] GGX width, not squared; Blender's roughness is its square root
    """

    kd: Pixels
    ks: Pixels
    alpha: Pixels

    def planes(self) -> Pixels:
        """States [C, H W], plane after plane (`channels`)."""
        planes = np.empty((WIDTH, self.size[0] * self.size[1]), np.float32)
        for channel, pixels in ((KD, self.kd), (KS, self.ks), (ALPHA, self.alpha)):
            planes[channel] = pixels.reshape(planes.shape[1], -1).T
        return planes

    @classmethod
    def of(cls, planes: Pixels, size: tuple[int, int] | None = None) -> TorranceSparrowMaps:
        """Views of states [C, n] as maps of `size`, by default one texel wide."""
        height, width = size or (planes.shape[1], 1)
        kd, ks = (planes[channel].T.reshape(height, width, 3) for channel in (KD, KS))
        return cls(kd, ks, planes[ALPHA.start].reshape(height, width))


@dataclass(frozen=True)
class PrincipledMaps(_SizedMaps):
    """The sockets of Blender's Principled BSDF that aging reads.

    base_color:     [H, W, 3]
    metallic:       [H, W] 0 to 1
    specular:       [H, W] Specular IOR Level, 0.5 leaves the IOR's own F0
    roughness:      [H, W] 0 to 1
    ior:            [H, W] index of refraction
    specular_tint:  [H, W, 3]
    """

    base_color: Pixels
    metallic: Pixels
    specular: Pixels
    roughness: Pixels
    ior: Pixels
    specular_tint: Pixels


Maps = TorranceSparrowMaps | PrincipledMaps
