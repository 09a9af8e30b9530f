"""Torrance-Sparrow: f = Kd/pi + Ks D G / (4 cos_i cos_o) of docs/design.md, in float64 numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from model_runtime.brdf.half_angle import above_horizon, directions, from_directions
from model_runtime.brdf.torrance_sparrow import evaluate, specular_lobe
from model_runtime.channels import ALPHA_MIN

ALPHAS = (1e-4, 1e-3, 0.01, 0.1, 0.3, 0.7, 1.0)


def ggx(alpha: float, cos_h: np.ndarray) -> np.ndarray:
    """D of Walter et al. 2007, equation 33: a^2 / (pi cos^4 (a^2 + tan^2)^2)."""
    tan2 = (1 - cos_h**2) / cos_h**2
    return alpha**2 / (math.pi * cos_h**4 * (alpha**2 + tan2) ** 2)


def smith(alpha: float, cos: np.ndarray) -> np.ndarray:
    """G1 of Walter et al. 2007, equation 34: 2 / (1 + sqrt(1 + a^2 tan^2))."""
    return 2 / (1 + np.sqrt(1 + alpha**2 * (1 - cos**2) / cos**2))


def by_directions(
    kd: np.ndarray, ks: np.ndarray, alpha: float, wi: np.ndarray, wo: np.ndarray
) -> np.ndarray:
    half = wi + wo
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    cos_i, cos_o, cos_h = wi[..., 2], wo[..., 2], half[..., 2]
    lobe = ggx(alpha, cos_h) * smith(alpha, cos_i) * smith(alpha, cos_o) / (4 * cos_i * cos_o)
    return kd / math.pi + ks * lobe[..., None]


def visible_angles(count: int, seed: int = 0) -> torch.Tensor:
    g = torch.Generator().manual_seed(seed)
    angles = torch.rand(4 * count, 3, generator=g, dtype=torch.float64)
    angles = angles * torch.tensor((math.pi / 2, math.pi / 2, 2 * math.pi))
    return angles[above_horizon(angles, margin=0.01)][:count]


@pytest.mark.parametrize("alpha", [1e-3, 0.01, 0.1, 0.3, 0.7, 1.0])
def test_against_the_published_formula(alpha: float):
    angles = visible_angles(500)
    kd, ks = np.array((0.3, 0.1, 0.02)), np.array((0.04, 0.6, 1.0))
    expected = by_directions(kd, ks, alpha, *(w.numpy() for w in directions(angles)))
    wide = (torch.tensor(x, dtype=torch.float64)[None] for x in (kd, ks))
    got = evaluate(*wide, torch.tensor([alpha], dtype=torch.float64), angles)[0]
    # The formula's own 1 - cos^2 loses digits about the mirror direction; ours does not.
    np.testing.assert_allclose(got, expected, rtol=1e-8)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_single_precision_holds_up_to_the_mirror_direction(alpha: float):
    """tan^2 instead of 1 - cos^2 in double precision is exact however near the mirror is."""
    theta_h = torch.tensor((0.0, 1e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 0.01, 0.1, 0.5, 1.0))
    angles = torch.stack((theta_h, torch.full_like(theta_h, 0.4), torch.full_like(theta_h, 1.1)), 1)
    wide = angles.double()
    tan2 = np.tan(wide[:, 0].numpy()) ** 2
    cos_h = np.cos(wide[:, 0].numpy())
    cos_i, cos_o = (w[:, 2].numpy() for w in directions(wide))
    d = alpha**2 / (math.pi * cos_h**4 * (alpha**2 + tan2) ** 2)
    expected = d * smith(alpha, cos_i) * smith(alpha, cos_o) / (4 * cos_i * cos_o)
    got = specular_lobe(torch.tensor([alpha]), angles)[0]
    np.testing.assert_allclose(got, expected, rtol=2e-5)


@settings(deadline=None, max_examples=50)
@given(
    st.floats(1e-4, 1),
    st.floats(0, math.pi / 2),
    st.floats(0, math.pi / 2),
    st.floats(0, 2 * math.pi),
)
def test_finite_and_not_negative_everywhere(alpha, theta_h, theta_d, phi_d):
    """Below the horizon too, where callers mask."""
    angles = torch.tensor([[theta_h, theta_d, phi_d]])
    f = evaluate(torch.rand(1, 3), torch.rand(1, 3), torch.tensor([alpha]), angles)
    assert bool(torch.isfinite(f).all())
    assert float(f.min()) >= 0


@pytest.mark.parametrize("alpha", ALPHAS)
def test_finite_at_the_horizon(alpha: float):
    """Where the textbook formula is 0 / 0, the value is its limit."""
    wi = torch.tensor([[1.0, 0.0, 0.0]], dtype=torch.float64)
    wo = torch.tensor([[-0.6, 0.0, 0.8]], dtype=torch.float64)
    got = specular_lobe(torch.tensor([alpha], dtype=torch.float64), from_directions(wi, wo))
    cos = 1e-9  # as near to 0 as the textbook formula carries
    near = np.array([[math.sqrt(1 - cos**2), 0, cos]])
    zero, one = np.zeros(3), np.ones(3)
    limit = by_directions(zero, one, alpha, near, wo.numpy())[0, 0]
    assert got.item() == pytest.approx(limit, rel=1e-4)


@pytest.mark.parametrize("alpha", [1e-4, 1e-3, 0.03, 0.2, 0.6, 1.0])
def test_the_distribution_is_normalized(alpha: float):
    """The projected area of all microfacets is 1: integral of D cos_h over half vectors.

    At theta_d = 0 the two directions are the half vector, so D = 4 cos^2 f / G1^2. tan theta =
    alpha s makes the integrand equally wide for every alpha.
    """
    s = (np.arange(200_000) + 0.5) / 200_000
    tan = alpha * np.sqrt(s / (1 - s))  # the share s of the microfacets lies within this slope
    theta = np.arctan(tan)
    angles = np.stack((theta, np.zeros_like(theta), np.zeros_like(theta)), 1)
    one = torch.tensor([alpha], dtype=torch.float64)
    lobe = specular_lobe(one, torch.from_numpy(angles))[0].numpy()
    cos = np.cos(theta)
    d = 4 * cos**2 * lobe / smith(alpha, cos) ** 2
    # 2 pi D cos sin dtheta; with u = tan^2: 2 sin cos dtheta = cos^4 du
    du_ds = alpha**2 / (1 - s) ** 2
    assert np.mean(math.pi * d * cos**4 * du_ds) == pytest.approx(1, rel=1e-3)


@pytest.mark.parametrize("alpha", [1e-4, 0.01, 0.1, 0.4, 1.0])
@pytest.mark.parametrize("view", [0.0, 0.7, 1.3, 1.55])
def test_no_view_reflects_more_than_it_gets(alpha: float, view: float):
    """Directional albedo: integral of f cos_i over incoming directions, by half vectors.

    dwi = 4 (h.wo) dh. Smooth surfaces reflect nearly all, rough ones less (single scattering).
    """
    n, m = 600, 96
    s = (np.arange(n) + 0.5) / n
    theta = np.arctan(alpha * np.sqrt(s / (1 - s)))[:, None]
    phi = ((np.arange(m) + 0.5) / m * 2 * math.pi)[None]
    half = np.stack(
        np.broadcast_arrays(
            np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
        ),
        -1,
    )
    wo = np.array((math.sin(view), 0, math.cos(view)))
    along = half @ wo
    wi = 2 * along[..., None] * half - wo
    seen = (along > 0) & (wi[..., 2] > 0)
    angles = from_directions(
        torch.from_numpy(wi.reshape(-1, 3)),
        torch.from_numpy(np.broadcast_to(wo, wi.shape).copy()).reshape(-1, 3),
    )
    f = specular_lobe(torch.tensor([alpha], dtype=torch.float64), angles)[0].numpy().reshape(n, m)
    cos = np.cos(theta)
    # dh = sin dtheta dphi, and with u = tan^2: sin dtheta = cos^3 du / 2
    dh = math.pi * cos**3 * alpha**2 / (1 - s[:, None]) ** 2 / n / m
    albedo = float(np.sum(np.where(seen, f * wi[..., 2] * 4 * along * dh, 0)))
    assert albedo < 1.001
    if alpha <= 0.1 and view <= 0.7:
        assert albedo > 0.97


def test_reciprocal_and_linear():
    angles = visible_angles(100).float()
    swapped = angles + torch.tensor((0, 0, math.pi))
    kd, ks, alpha = torch.rand(5, 3), torch.rand(5, 3), torch.rand(5)
    f = evaluate(kd, ks, alpha, angles)
    assert f.shape == (5, 100, 3)
    torch.testing.assert_close(evaluate(kd, ks, alpha, swapped), f, rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(evaluate(2 * kd, 2 * ks, alpha, angles), 2 * f)


def test_alpha_below_the_least_counts_as_the_least():
    angles = visible_angles(20).float()
    tiny, least = (specular_lobe(torch.tensor([a]), angles) for a in (0.0, ALPHA_MIN))
    assert torch.equal(tiny, least)
