"""How a BRDF looks: a few views of it under a few lamps, as tone-mapped pixels.

Lists of BRDF values say little of how near two materials look: a lobe that is a little narrower is
far off in some directions, and nobody sees it. So materials that only measurements know are held
against what is made of them by what would be seen: flat samples of them, each from one direction,
each under one soft lamp in a gray sky.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

from ..backend import Tensor, torch
from .half_angle import from_directions

__all__ = ("Views", "other_views", "psnr_of", "tone_map", "views")

_GRAZING = 0.1
"""Least cosine of light and eye: what is closer to the horizon is hardly seen, and hardly
measured."""

_GOLDEN = (math.sqrt(5) - 1) / 2
_NARROWEST, _WIDEST = 0.08, 0.6  # of lamps, radians
_SKY = 0.4  # of the light
_BLACK = 1e-5  # radiance below which the tone curve, steep at 0, is cut


def tone_map(radiance: Tensor, exposure: float = 1.0) -> Tensor:
    """(1 - exp(-2 v))^(1 / 2.8), the gamma correction of the paper's section 4.2, of radiance v,
    which is at least 0, times the exposure.
    """
    return (1 - torch.exp(-2 * exposure * radiance)).pow(1 / 2.8)


@dataclass(frozen=True)
class Views:
    """V directions of view, each with D directions of light, under L lamps.

    angles: [V D, 3], at which BRDFs are wanted
    weights: [V, L, D] radiance x cosine x solid angle, 0 below the horizon; a lamp and its sky
        have mean radiance 1
    """

    angles: Tensor
    weights: Tensor

    @classmethod
    def of(cls, count: int, directions: int, lamps: int, start: float) -> Views:
        """`start`, 0 to 1, tells two sets apart: no direction or lamp is in both."""
        up = 1 - (1 - _GRAZING) * (torch.arange(count, dtype=torch.float64) + start) / count
        eye = torch.stack(((1 - up * up).sqrt(), 0 * up, up), -1)
        # Half vectors lie closest about the normal, where lobes have their peaks; what is left
        # and what is right of the plane of view looks the same.
        place = (torch.arange(directions, dtype=torch.float64) + start) / directions
        theta = place**2.5 * math.pi / 2
        measure = theta.sin() * 2.5 * place**1.5 * math.pi / 2
        phi = math.pi * ((torch.arange(directions) * _GOLDEN + start) % 1)
        half = torch.stack((theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()), -1)
        between = eye @ half.T
        light = 2 * between[..., None] * half - eye[:, None]
        seen = (between > 0) & (light[..., 2] > _GRAZING)
        solid = 4 * between * measure * 2 * math.pi / directions
        weights = torch.where(seen, solid * light[..., 2], 0)[:, None] * _lamps(light, lamps, start)
        angles = from_directions(light, eye[:, None].expand_as(light))
        angles = torch.where(seen[..., None], angles, 0)
        return cls(angles.flatten(0, 1).float(), weights.float())

    def seen(self, f: Tensor) -> Tensor:
        """Tone-mapped pixels [N, V, L, 3] of N BRDFs `f` [N, V D, 3] at `angles`."""
        radiance = torch.einsum(
            "vld,nvdc->nvlc", self.weights, f.unflatten(1, self.weights.shape[::2])
        )
        return tone_map(radiance.clamp_min(0) + _BLACK)


def _lamps(light: Tensor, count: int, start: float) -> Tensor:
    """Radiance [V, L, D] that lamps, of all widths and all over the sky, and a last one that is
    all sky, send from `light` [V, D, 3].
    """
    place = torch.arange(count, dtype=torch.float64)
    up = (place + start) / count
    turn = 2 * math.pi * ((place * _GOLDEN + start) % 1)
    flat = (1 - up * up).sqrt()
    lamp = torch.stack((flat * turn.cos(), flat * turn.sin(), up), -1)
    width = _NARROWEST * (_WIDEST / _NARROWEST) ** ((place * 3 * _GOLDEN + start) % 1)
    sharpness = (width**-2)[:, None]
    mirrored = light * light.new_tensor((1, -1, 1))
    lit = sum(
        torch.exp(sharpness * (torch.einsum("lc,vdc->vld", lamp, each) - 1))
        for each in (light, mirrored)
    )
    assert isinstance(lit, Tensor)
    return torch.cat(((1 - _SKY) * sharpness * lit + _SKY, torch.ones_like(lit[:, :1])), 1)


@cache
@torch.inference_mode(False)  # training asks for gradients through what aging made first
def views() -> Views:
    """Those that are read where something is fitted."""
    return Views.of(8, 128, 32, 0.5)


@cache
@torch.inference_mode(False)
def other_views() -> Views:
    """Those that are held back, to tell whether it fits."""
    return Views.of(6, 150, 25, 0.27)


def psnr_of(truth: Tensor, estimate: Tensor) -> Tensor:
    """PSNR in dB [N], at most 100, of pixels [N, ...]."""
    error = (truth - estimate).square().flatten(1).mean(1)
    return -10 * error.clamp_min(1e-10).log10()
