"""The Torrance-Sparrow BRDF with GGX and flat Fresnel (docs/design.md, Conventions)."""

from __future__ import annotations

import math

from ..backend import Tensor, torch
from ..channels import ALPHA_MIN
from .half_angle import cosines

__all__ = ("evaluate", "ggx", "specular_lobe", "unbounded_lobe")


def specular_lobe(alpha: Tensor, angles: Tensor) -> Tensor:
    """rho_s = D G / (4 cos_i cos_o): [N, M] for `alpha` [N] (GGX, not squared) and `angles` [M, 3].

    D = a^2 / (pi (cos_h^2 (a^2 - 1) + 1)^2), G = G1(i) G1(o), G1(v) = 2 / (1 + sqrt(1 + a^2 tan^2
    v)). The cosines cancel inside G1: G1(v) / cos_v = 2 / (cos_v + sqrt(cos_v^2 + a^2 sin^2 v)), so
    that the value stays finite at the horizon. sin^2 theta_h is used for 1 - cos_h^2, which keeps
    mirrors (alpha = 1e-4) exact in single precision.
    """
    return unbounded_lobe(alpha.clamp_min(ALPHA_MIN), angles)


def unbounded_lobe(alpha: Tensor, angles: Tensor) -> Tensor:
    """`specular_lobe` of any alpha > 0, even where nothing is that smooth."""
    cos_i, cos_o, _, _ = cosines(angles)
    a2 = alpha.square()[:, None]

    def masking_over_cosine(cos: Tensor) -> Tensor:
        cos = cos.clamp(0, 1)
        return 2 / (cos + (cos.square() + a2 * (1 - cos.square())).sqrt())

    return ggx(a2, angles) * masking_over_cosine(cos_i) * masking_over_cosine(cos_o) / 4


def ggx(a2: Tensor, angles: Tensor) -> Tensor:
    """D [N, M] for squared alphas `a2` [N, 1], with sin^2 theta_h for 1 - cos_h^2 (see
    `specular_lobe`).
    """
    sin2_h = angles[..., 0].sin().square()
    return a2 / (math.pi * (sin2_h + a2 * (1 - sin2_h)).square())


def evaluate(kd: Tensor, ks: Tensor, alpha: Tensor, angles: Tensor) -> Tensor:
    """f = Kd / pi + Ks rho_s, per steradian: [N, M, 3] for kd, ks [N, 3], alpha [N], angles
    [M, 3].
    """
    lobe = specular_lobe(alpha, angles)
    return torch.addcmul(kd[:, None, :] / math.pi, ks[:, None, :], lobe[:, :, None])
