"""Fitting Torrance-Sparrow: what was put in comes out, whatever the scale, gaps, batch, threads."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from model_runtime.brdf import disney
from model_runtime.brdf.fit import Fit, fit_angles, fit_torrance_sparrow
from model_runtime.brdf.half_angle import above_horizon, directions

pytestmark = pytest.mark.usefixtures("one_thread")

ALPHAS = st.floats(math.log(1e-4), 0).map(math.exp)
LEAST = float(np.float32(1e-4))


def reflectance(kd: ArrayLike, ks: ArrayLike, alpha: ArrayLike, angles: torch.Tensor) -> np.ndarray:
    """f of docs/design.md for kd, ks [N, 3], alpha [N]: float64 [N, M, 3], in numpy."""
    kd, ks = (np.atleast_2d(np.asarray(x, float)) for x in (kd, ks))
    alpha = np.atleast_1d(np.asarray(alpha, float))[:, None]
    cos_i, cos_o = (w[:, 2].numpy() for w in directions(angles.double()))
    tan2 = np.tan(angles[:, 0].double().numpy()) ** 2
    d = alpha**2 * (1 + tan2) ** 2 / (math.pi * (alpha**2 + tan2) ** 2)
    g = 1.0
    for cos in (cos_i, cos_o):
        g = g * 2 / (1 + np.sqrt(1 + alpha**2 * (1 / cos**2 - 1)))
    lobe = d * g / (4 * cos_i * cos_o)
    return kd[:, None] / math.pi + ks[:, None] * lobe[..., None]


def fit(kd: ArrayLike, ks: ArrayLike, alpha: ArrayLike, **options) -> Fit:
    """The fit of single-precision values, as BRDFs travel."""
    f = reflectance(kd, ks, alpha, fit_angles())
    return fit_torrance_sparrow(torch.from_numpy(f).float(), **options)


def random_states(n: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.random((n, 3)), rng.uniform(0.01, 1, (n, 3)), np.exp(rng.uniform(-9.2, 0, n))


def test_the_directions_lie_above_the_horizon_and_near_the_mirror():
    angles = fit_angles()
    assert 200 < len(angles) < 500
    assert bool(above_horizon(angles).all())
    assert float(angles[:, 0].min()) < math.radians(0.01)
    assert float(angles[:, 0].max()) > math.radians(60)


def test_hundreds_of_materials_are_recovered():
    kd, ks, alpha = random_states(300, 1)
    found = fit(kd, ks, alpha)
    np.testing.assert_allclose(found.kd, kd, atol=1e-3)
    np.testing.assert_allclose(found.ks, ks, atol=1e-3)
    np.testing.assert_allclose(found.alpha, alpha, rtol=1e-3)
    assert float(found.error.max()) < 1e-4


unit = st.floats(0, 1)
color = st.tuples(unit, unit, unit)


@settings(deadline=None, max_examples=15)
@given(st.lists(st.tuples(color, color, ALPHAS), min_size=1, max_size=12))
def test_any_material_is_recovered(materials):
    kd, ks, alpha = (np.array(values) for values in zip(*materials, strict=True))
    found = fit(kd, ks, alpha)
    np.testing.assert_allclose(found.kd, kd, atol=1e-3)
    np.testing.assert_allclose(found.ks, ks, atol=1e-3)
    shiny = ks.max(1) > 0.01  # else there is no lobe to measure
    np.testing.assert_allclose(found.alpha[shiny], alpha[shiny], rtol=1e-3)


@settings(deadline=None, max_examples=10)
@given(st.lists(st.tuples(color, st.floats(0.01, 1), ALPHAS), min_size=1, max_size=12))
def test_mono_recovers_one_specular_for_all_channels(materials):
    kd, ks, alpha = (np.array(values) for values in zip(*materials, strict=True))
    gray = np.repeat(ks[:, None], 3, 1)
    found = fit(kd, gray, alpha, specular="mono")
    np.testing.assert_allclose(found.kd, kd, atol=1e-3)
    np.testing.assert_allclose(found.ks, gray, atol=1e-3)
    np.testing.assert_allclose(found.alpha, alpha, rtol=1e-3)


def test_mono_of_a_colored_metal_is_gray_and_between():
    found = fit((0.02, 0.02, 0.01), (0.95, 0.64, 0.35), 0.1, specular="mono")
    assert found.ks[0, 0] == found.ks[0, 1] == found.ks[0, 2]
    assert 0.35 < float(found.ks[0, 0]) < 0.95
    assert float(found.kd.min()) >= 0
    assert float(found.error[0]) > 0.1  # and it says that this is no exact fit


@pytest.mark.parametrize("specular", ["rgb", "mono"])
def test_a_diffuse_material_has_no_specular(specular):
    found = fit((0.5, 0.2, 0.1), (0, 0, 0), 0.3, specular=specular)
    np.testing.assert_allclose(found.kd[0], (0.5, 0.2, 0.1), atol=1e-4)
    np.testing.assert_allclose(found.ks[0], 0, atol=1e-4)
    assert LEAST <= float(found.alpha[0]) <= 1


def test_a_metal_has_no_diffuse():
    found = fit((0, 0, 0), (0.95, 0.64, 0.35), 0.2)
    np.testing.assert_allclose(found.kd[0], 0, atol=1e-4)
    np.testing.assert_allclose(found.ks[0], (0.95, 0.64, 0.35), atol=1e-4)


@pytest.mark.parametrize("specular", ["rgb", "mono"])
def test_black(specular):
    found = fit((0, 0, 0), (0, 0, 0), 0.5, specular=specular)
    assert found.parameters()[0, :6].tolist() == [0] * 6
    assert LEAST <= float(found.alpha[0]) <= 1
    assert float(found.error[0]) == 0


@pytest.mark.parametrize("alpha", [1e-4, 1.5e-4, 1.0])
def test_the_ends_of_alpha(alpha: float):
    found = fit((0.1, 0.1, 0.1), (0.9, 0.9, 0.9), alpha)
    np.testing.assert_allclose(found.kd[0], 0.1, atol=1e-3)
    np.testing.assert_allclose(found.ks[0], 0.9, atol=1e-3)
    assert found.alpha[0].item() == pytest.approx(alpha, rel=1e-3)


@pytest.mark.parametrize("broken", [math.nan, math.inf, -math.inf])
def test_samples_that_are_no_numbers_are_left_out(broken: float):
    kd, ks, alpha = random_states(20, 2)
    f = torch.from_numpy(reflectance(kd, ks, alpha, fit_angles()))
    gaps = torch.rand(f.shape[:2], generator=torch.Generator().manual_seed(4)) < 0.3
    f[gaps] = broken
    f[0, 5, 1] = broken  # one channel of a sample
    found = fit_torrance_sparrow(f)
    np.testing.assert_allclose(found.kd, kd, atol=1e-3)
    np.testing.assert_allclose(found.ks, ks, atol=1e-3)
    np.testing.assert_allclose(found.alpha, alpha, rtol=1e-3)


def other_brdfs(n: int) -> torch.Tensor:
    """Disney materials, which no Torrance-Sparrow lobe fits exactly."""
    g = torch.Generator().manual_seed(7)
    drawn = [torch.rand(n, *shape, generator=g) for shape in ((3,), *[()] * 10)]
    return disney.evaluate(disney.DisneyParameters(*drawn), fit_angles())


@pytest.mark.parametrize("scale", [0.2, 7.0])
def test_a_brighter_material_differs_in_brightness_alone(scale: float):
    f = other_brdfs(30) + 0.05
    once, scaled = fit_torrance_sparrow(f), fit_torrance_sparrow(f * scale)
    torch.testing.assert_close(scaled.kd / scale, once.kd, rtol=0.02, atol=2e-3)
    torch.testing.assert_close(scaled.ks / scale, once.ks, rtol=0.02, atol=2e-3)
    torch.testing.assert_close(scaled.alpha, once.alpha, rtol=0.02, atol=1e-4)


def test_what_cannot_be_fitted_stays_in_range_and_says_how_far_off_it_is():
    f = other_brdfs(100)
    found = fit_torrance_sparrow(f)
    for value in (found.kd, found.ks, found.alpha, found.error):
        assert bool(torch.isfinite(value).all())
    assert float(found.parameters().min()) >= 0
    assert LEAST <= float(found.alpha.min()) <= float(found.alpha.max()) <= 1
    assert 0 < float(found.error.max()) <= 1


def test_the_fit_is_at_least_as_good_as_the_best_of_a_scan():
    """Non-negative least squares at 60 alphas, by scipy, weighted as the fit says: relative."""
    from scipy.optimize import nnls

    angles = fit_angles()
    f = other_brdfs(4).double()
    found = fit_torrance_sparrow(f)
    cosines = np.prod([w[:, 2].numpy() for w in directions(angles.double())], axis=0)
    brightness = f.mean(-1)
    floor = 0.05 * brightness.median(1, keepdim=True).values + 1e-4
    for k in range(4):
        weight = np.sqrt(cosines) / (brightness + floor)[k].numpy()
        values = f[k].numpy() * weight[:, None]

        def misfit(alpha: float, weight=weight, values=values) -> float:
            basis = np.stack(
                [
                    weight * reflectance([(kd,) * 3], [(ks,) * 3], alpha, angles)[0, :, 0]
                    for kd, ks in ((1, 0), (0, 1))
                ],
                1,
            )
            residuals = [nnls(basis, values[:, channel])[1] for channel in range(3)]
            return float(np.linalg.norm(residuals) / np.linalg.norm(values))

        best = min(misfit(alpha) for alpha in np.geomspace(1e-4, 1, 60))
        assert float(found.error[k]) <= best * 1.001


def test_batches_and_threads_change_nothing():
    f = other_brdfs(24)
    whole = fit_torrance_sparrow(f).parameters()
    parts = torch.cat([fit_torrance_sparrow(part).parameters() for part in f.split(7)])
    torch.testing.assert_close(parts, whole, rtol=1e-5, atol=1e-7)
    torch.set_num_threads(2)
    torch.testing.assert_close(fit_torrance_sparrow(f).parameters(), whole, rtol=1e-5, atol=1e-7)


def test_more_brdfs_than_a_chunk():
    kd, ks, alpha = random_states(7, 5)
    f = torch.from_numpy(reflectance(kd, ks, alpha, fit_angles())).float()
    many = fit_torrance_sparrow(f.repeat(590, 1, 1))
    assert many.parameters().shape == (4130, 7)
    np.testing.assert_allclose(many.alpha[-7:], alpha, rtol=1e-3)
    torch.testing.assert_close(many.parameters()[:7], many.parameters()[-7:], rtol=1e-5, atol=1e-7)
