"""A measured BRDF, whatever file it came from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..backend import Tensor

__all__ = ("BRIGHTEST", "MeasuredBRDF")

BRIGHTEST = 1e9
"""No material reflects more per steradian: the sharpest lobe that maps hold reaches 3e7."""


@dataclass(frozen=True)
class MeasuredBRDF:
    """An isotropic material known by its values only.

    name:      what its file is called, without folder and ending
    evaluate:  angles [M, 3] (half-angle coordinates, radians) -> f [M, 3], linear RGB per
               steradian, never negative, 0 where either direction is below the horizon. Values are
               what the file holds, with wi the incident direction: measurements are not exactly
               reciprocal, and nothing is averaged here (of an isotropic material, phi_d from 0 to
               pi shows each pair of directions in both orders).
    """

    name: str
    evaluate: Callable[[Tensor], Tensor]
