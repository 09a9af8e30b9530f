"""The Disney BRDF against Burley's course notes (2012), worked out again for one pair of directions
at a time, with plain numbers and vectors instead of half-angle coordinates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
import pytest
import torch

from model_runtime.brdf.disney import DisneyParameters, evaluate
from model_runtime.brdf.half_angle import above_horizon, directions, from_directions


@dataclass(frozen=True)
class Settings:
    base_color: tuple[float, float, float] = (0.5, 0.25, 0.1)
    subsurface: float = 0.0
    metallic: float = 0.0
    specular: float = 0.5
    specular_tint: float = 0.0
    roughness: float = 0.4
    anisotropic: float = 0.0
    sheen: float = 0.0
    sheen_tint: float = 0.5
    clearcoat: float = 0.0
    clearcoat_gloss: float = 1.0

    def tensors(self, kind: torch.dtype = torch.float64) -> DisneyParameters:
        return DisneyParameters(
            *(torch.tensor([getattr(self, f.name)], dtype=kind) for f in fields(self))
        )


def mix(a: float, b: float, share: float) -> float:
    return (1 - share) * a + share * b


def course_notes(p: Settings, light: np.ndarray, eye: np.ndarray) -> list[float]:
    """Sections 5.3 to 5.6 of "Physically-Based Shading at Disney", x the tangent, z the normal."""
    middle = light + eye
    middle = middle / math.sqrt(float(middle @ middle))
    n_l, n_v, n_h, l_h = light[2], eye[2], middle[2], float(light @ middle)
    luminance = 0.3 * p.base_color[0] + 0.6 * p.base_color[1] + 0.1 * p.base_color[2]
    weight_l, weight_v, weight_h = ((1 - c) ** 5 for c in (n_l, n_v, l_h))

    fd90 = 0.5 + 2 * p.roughness * l_h**2
    diffuse = mix(1, fd90, weight_l) * mix(1, fd90, weight_v)
    fss90 = p.roughness * l_h**2
    fss = mix(1, fss90, weight_l) * mix(1, fss90, weight_v)
    subsurface = 1.25 * (fss * (1 / (n_l + n_v) - 0.5) + 0.5)

    aspect = math.sqrt(1 - 0.9 * p.anisotropic)
    ax, ay = max(1e-3, p.roughness**2 / aspect), max(1e-3, p.roughness**2 * aspect)
    slope = (middle[0] / ax) ** 2 + (middle[1] / ay) ** 2 + n_h**2
    gtr2 = 1 / (math.pi * ax * ay * slope**2)

    def shadow(w: np.ndarray) -> float:  # G1 / (2 cos)
        return 1 / (w[2] + math.sqrt((ax * w[0]) ** 2 + (ay * w[1]) ** 2 + w[2] ** 2))

    coat_alpha = mix(0.1, 0.001, p.clearcoat_gloss)
    a2 = coat_alpha**2
    sin2_h = middle[0] ** 2 + middle[1] ** 2
    gtr1 = (a2 - 1) / (math.pi * math.log(a2) * (a2 * n_h**2 + sin2_h))

    def coat_shadow(cos: float) -> float:
        return 1 / (cos + math.sqrt(0.25**2 + cos**2 - 0.25**2 * cos**2))

    coat = 0.25 * p.clearcoat * gtr1 * mix(0.04, 1, weight_h) * coat_shadow(n_l) * coat_shadow(n_v)
    result = []
    for base in p.base_color:
        tint = base / luminance if luminance > 0 else 1.0
        f0 = mix(0.08 * p.specular * mix(1, tint, p.specular_tint), base, p.metallic)
        sheen = weight_h * p.sheen * mix(1, tint, p.sheen_tint)
        body = (mix(diffuse, subsurface, p.subsurface) * base / math.pi + sheen) * (1 - p.metallic)
        specular = gtr2 * mix(f0, 1, weight_h) * shadow(light) * shadow(eye)
        result.append(body + specular + coat)
    return result


def pairs(count: int = 60) -> torch.Tensor:
    """Half-angle coordinates; the half vector lies in the x-z plane (phi_h = 0)."""
    g = torch.Generator().manual_seed(5)
    angles = torch.rand(8 * count, 3, generator=g, dtype=torch.float64)
    angles = angles * torch.tensor((1.5, 1.5, 2 * math.pi))
    mirror = torch.tensor([[0, 0.5, 1], [1e-3, 0.5, 1], [0, 0, 0], [0.02, 1.4, 1.5]])
    angles = torch.cat((mirror.double(), angles))
    return angles[above_horizon(angles, margin=0.02)][:count]


CASES = {
    "plain": Settings(),
    "smooth": Settings(roughness=0.05),
    "rough": Settings(roughness=1.0),
    "metal": Settings(metallic=1.0, roughness=0.3),
    "half metal": Settings(metallic=0.5, specular=1.0),
    "specular tint": Settings(specular=1.0, specular_tint=0.7),
    "sheen": Settings(sheen=1.0, sheen_tint=1.0, roughness=0.8),
    "pale sheen": Settings(sheen=0.6, sheen_tint=0.0),
    "subsurface": Settings(subsurface=1.0),
    "clearcoat": Settings(clearcoat=1.0, clearcoat_gloss=1.0),
    "dull clearcoat": Settings(clearcoat=0.8, clearcoat_gloss=0.0, metallic=1.0),
    "anisotropic": Settings(anisotropic=1.0, metallic=1.0, roughness=0.5),
    "half anisotropic": Settings(anisotropic=0.5, roughness=0.3),
    "black": Settings(base_color=(0.0, 0.0, 0.0), sheen=1.0, sheen_tint=1.0, specular_tint=1.0),
    "mirror": Settings(roughness=0.0, metallic=1.0),
    "all at once": Settings((0.9, 0.2, 0.4), 0.3, 0.2, 0.7, 0.4, 0.35, 0.6, 0.5, 0.2, 0.9, 0.6),
}


@pytest.mark.parametrize("settings", CASES.values(), ids=CASES.keys())
def test_the_course_notes(settings: Settings):
    angles = pairs()
    wi, wo = (w.numpy() for w in directions(angles))
    expected = [course_notes(settings, light, eye) for light, eye in zip(wi, wo, strict=True)]
    got = evaluate(settings.tensors(), angles)
    assert got.shape == (1, 60, 3)
    np.testing.assert_allclose(got[0], expected, rtol=1e-8)


@pytest.mark.parametrize("name", CASES)
def test_single_precision_agrees_with_double(name: str):
    settings, angles = CASES[name], pairs()
    wide = evaluate(settings.tensors(), angles)
    single = evaluate(settings.tensors(torch.float32), angles.float())
    np.testing.assert_allclose(single, wide, rtol=2e-3)


def test_many_materials_at_once_are_each_by_itself():
    one, other = CASES["clearcoat"].tensors(), CASES["anisotropic"].tensors()
    both = DisneyParameters(
        *(torch.cat((getattr(one, f.name), getattr(other, f.name))) for f in fields(one))
    )
    angles = pairs()
    torch.testing.assert_close(
        evaluate(both, angles), torch.cat((evaluate(one, angles), evaluate(other, angles)))
    )


@pytest.mark.parametrize("name", ["plain", "clearcoat", "subsurface", "anisotropic", "all at once"])
def test_reciprocal(name: str):
    angles = pairs()
    turned = angles + torch.tensor((0, 0, math.pi), dtype=torch.float64)
    p = CASES[name].tensors()
    torch.testing.assert_close(evaluate(p, angles), evaluate(p, turned), rtol=1e-9, atol=0)


def test_finite_and_not_negative_at_grazing_angles():
    g = torch.Generator().manual_seed(2)
    up = torch.rand(300, 2, generator=g) * torch.tensor((2 * math.pi, 0.01))
    cos = up[:, 1]
    sin = (1 - cos**2).sqrt()
    wi = torch.stack((sin * up[:, 0].cos(), sin * up[:, 0].sin(), cos), 1)
    wo = wi.flip(0)
    angles = from_directions(wi, wo)
    angles = angles[above_horizon(angles)]
    for settings in CASES.values():
        f = evaluate(replace(settings).tensors(torch.float32), angles)
        assert bool(torch.isfinite(f).all())
        assert float(f.min()) >= 0
