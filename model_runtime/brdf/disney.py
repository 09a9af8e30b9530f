"""The Disney "principled" BRDF with its eleven parameters (Burley, SIGGRAPH 2012 course notes)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..backend import Tensor, torch
from .half_angle import cosines, directions

__all__ = ("DisneyParameters", "evaluate")


@dataclass(frozen=True)
class DisneyParameters:
    """`base_color` [N, 3] linear; the ten others [N], each in 0..1 (anisotropic: x is the
    tangent).
    """

    base_color: Tensor
    subsurface: Tensor
    metallic: Tensor
    specular: Tensor
    specular_tint: Tensor
    roughness: Tensor
    anisotropic: Tensor
    sheen: Tensor
    sheen_tint: Tensor
    clearcoat: Tensor
    clearcoat_gloss: Tensor


def _schlick(cos: Tensor) -> Tensor:
    return (1 - cos).clamp(0, 1) ** 5


def _masking_over_cosine(cos: Tensor, a2: Tensor) -> Tensor:
    """Smith G1 of GGX over 2 cos: 1 / (cos + sqrt(a^2 + cos^2 - a^2 cos^2))."""
    return 1 / (cos + (a2 + cos.square() * (1 - a2)).sqrt())


def evaluate(parameters: DisneyParameters, angles: Tensor) -> Tensor:
    """f per steradian, [N, M, 3], at `angles` [M, 3] above the horizon.

    As in Burley's reference `disney.brdf` of 2012: alpha = roughness^2, the clearcoat lobe is GTR1
    with alpha 0.1..0.001 and G of fixed roughness 0.25. The half vector lies in the x-z plane
    (phi_h = 0), which only matters where `anisotropic` is not 0.
    """
    p = parameters
    cos_i, cos_o, _, cos_d = (c.clamp_min(1e-4) for c in cosines(angles))
    wi, wo = directions(angles)

    def column(value: Tensor) -> Tensor:
        return value[:, None]

    rough = column(p.roughness)
    base = p.base_color[:, None, :]
    luminance = (p.base_color @ p.base_color.new_tensor((0.3, 0.6, 0.1)))[:, None, None]
    tint = torch.where(luminance > 0, base / luminance.clamp_min(1e-6), torch.ones_like(base))
    ones = torch.ones_like(base)
    specular_color = torch.lerp(
        0.08 * p.specular[:, None, None] * torch.lerp(ones, tint, p.specular_tint[:, None, None]),
        base,
        p.metallic[:, None, None],
    )
    sheen_color = torch.lerp(ones, tint, p.sheen_tint[:, None, None])

    fresnel_i, fresnel_o, fresnel_d = _schlick(cos_i), _schlick(cos_o), _schlick(cos_d)
    retro = 0.5 + 2 * cos_d.square() * rough
    diffuse = (1 + (retro - 1) * fresnel_i) * (1 + (retro - 1) * fresnel_o)
    flat = cos_d.square() * rough
    flattened = (1 + (flat - 1) * fresnel_i) * (1 + (flat - 1) * fresnel_o)
    subsurface = 1.25 * (flattened * (1 / (cos_i + cos_o) - 0.5) + 0.5)

    aspect = (1 - 0.9 * column(p.anisotropic)).sqrt()
    alpha_x = (rough.square() / aspect).clamp_min(1e-3)
    alpha_y = (rough.square() * aspect).clamp_min(1e-3)
    sin2_h = angles[..., 0].sin().square()
    spread = sin2_h / alpha_x.square() + (1 - sin2_h)
    distribution = 1 / (math.pi * alpha_x * alpha_y * spread.square())

    def anisotropic_masking(w: Tensor) -> Tensor:
        stretched = (w[..., 0] * alpha_x).square() + (w[..., 1] * alpha_y).square()
        cos = w[..., 2].clamp_min(1e-4)
        return 1 / (cos + (stretched + cos.square()).sqrt())

    specular = distribution * anisotropic_masking(wi) * anisotropic_masking(wo)
    fresnel = torch.lerp(specular_color, ones, fresnel_d[None, :, None])

    gloss = torch.lerp(
        torch.full_like(rough, 0.1), torch.full_like(rough, 0.001), column(p.clearcoat_gloss)
    )
    g2 = gloss.square()
    coat_distribution = (g2 - 1) / (math.pi * g2.log() * (sin2_h + g2 * (1 - sin2_h)))
    coat_fresnel = 0.04 + 0.96 * fresnel_d
    quarter = cos_i.new_tensor(0.0625)
    coat_masking = _masking_over_cosine(cos_i, quarter) * _masking_over_cosine(cos_o, quarter)
    # Burley's smithG_GGX is 1 / (cos + sqrt(...)) for the coat too, with the cosines divided out
    coat = 0.25 * column(p.clearcoat) * coat_distribution * coat_fresnel * coat_masking

    dielectric = torch.lerp(diffuse, subsurface, column(p.subsurface))[:, :, None] * base / math.pi
    sheen = fresnel_d[None, :, None] * p.sheen[:, None, None] * sheen_color
    return (
        (dielectric + sheen) * (1 - p.metallic[:, None, None])
        + specular[:, :, None] * fresnel
        + coat[:, :, None]
    )
