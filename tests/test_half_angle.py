"""Half-angle coordinates, held against Rusinkiewicz's definition by rotation matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from model_runtime.brdf.half_angle import (
    above_horizon,
    cosines,
    directions,
    from_directions,
    network_input,
)

HALF_PI = math.pi / 2
polar = st.floats(0, HALF_PI)
azimuth = st.floats(-math.pi, math.pi)


def rotation_y(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array(((c, 0, s), (0, 1, 0), (-s, 0, c)))


def rotation_z(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array(((c, -s, 0), (s, c, 0), (0, 0, 1)))


def spherical(theta: float, phi: float) -> np.ndarray:
    return np.array(
        (math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta))
    )


def rusinkiewicz(wi: np.ndarray, wo: np.ndarray) -> tuple[float, float, float]:
    """(theta_h, theta_d, phi_d) by the definition: d = R_y(-theta_h) R_z(-phi_h) wi."""
    half = wi + wo
    half = half / np.linalg.norm(half)
    theta_h, phi_h = math.acos(min(1, half[2])), math.atan2(half[1], half[0])
    d = rotation_y(-theta_h) @ rotation_z(-phi_h) @ wi
    return theta_h, math.acos(np.clip(d[2], -1, 1)), math.atan2(d[1], d[0])


def angles_of(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def turned_apart(a: float, b: float) -> float:
    """The angle between two azimuths."""
    return abs((a - b + math.pi) % (2 * math.pi) - math.pi)


@given(polar, polar, azimuth)
def test_directions_follow_the_definition(theta_h: float, theta_d: float, phi_d: float):
    wi, wo = directions(angles_of(theta_h, theta_d, phi_d))
    tilt = rotation_y(theta_h)
    np.testing.assert_allclose(wi, tilt @ spherical(theta_d, phi_d), atol=1e-14)
    np.testing.assert_allclose(wo, tilt @ spherical(theta_d, phi_d + math.pi), atol=1e-14)


@given(st.floats(0.01, HALF_PI), st.floats(0.01, HALF_PI - 0.01), azimuth)
def test_angles_survive_the_way_to_directions_and_back(
    theta_h: float, theta_d: float, phi_d: float
):
    back = from_directions(*directions(angles_of(theta_h, theta_d, phi_d)))
    assert back[0].item() == pytest.approx(theta_h, abs=1e-9)
    assert back[1].item() == pytest.approx(theta_d, abs=1e-9)
    assert turned_apart(back[2].item(), phi_d) < 1e-9


@given(polar, azimuth, polar, azimuth)
def test_directions_survive_up_to_a_turn_about_the_normal(
    theta_i: float, phi_i: float, theta_o: float, phi_o: float
):
    """Only the turn phi_h is dropped: heights, opening angle and handedness stay."""
    before = spherical(theta_i, phi_i), spherical(theta_o, phi_o)
    if np.linalg.norm(before[0] + before[1]) < 1e-3:
        return  # opposite directions have no half vector
    pair = (torch.from_numpy(w) for w in before)
    after = [w.numpy() for w in directions(from_directions(*pair))]
    for wanted, got in zip(before, after, strict=True):
        assert got[2] == pytest.approx(wanted[2], abs=1e-9)
    assert after[0] @ after[1] == pytest.approx(before[0] @ before[1], abs=1e-9)
    assert np.cross(*after)[2] == pytest.approx(np.cross(*before)[2], abs=1e-9)


@given(st.floats(0.05, 1.5), azimuth, st.floats(0.05, 1.5), azimuth, st.sampled_from([1e-12, 2e-6]))
def test_angles_of_directions_follow_the_definition(
    theta_i: float, phi_i: float, theta_o: float, phi_o: float, precision: float
):
    wi, wo = spherical(theta_i, phi_i), spherical(theta_o, phi_o)
    half = wi + wo
    if np.hypot(half[0], half[1]) < 0.1 or np.linalg.norm(np.cross(wi, wo)) < 0.1:
        return  # phi_d is ill conditioned about the normal, and where the directions are one
    kind = torch.float64 if precision < 1e-9 else torch.float32
    got = from_directions(*(torch.tensor(w, dtype=kind) for w in (wi, wo)))
    wanted = rusinkiewicz(wi, wo)
    tolerance = max(1e-7, 10 * precision)  # acos loses half of the digits at its ends
    assert got[0].item() == pytest.approx(wanted[0], abs=tolerance)
    assert got[1].item() == pytest.approx(wanted[1], abs=tolerance)
    assert turned_apart(got[2].item(), wanted[2]) < 10 * tolerance


@pytest.mark.parametrize(
    ("wi", "wo", "expected"),
    [
        ((0, 0, 1), (0, 0, 1), (0, 0, None)),  # light and eye above
        ((1, 0, 0), (-1, 0, 1e-9), (None, HALF_PI, None)),  # grazing, nearly opposite
        ((0.6, 0, 0.8), (-0.6, 0, 0.8), (0, math.asin(0.6), 0)),  # the mirror direction
        ((0.6, 0, 0.8), (0.6, 0, 0.8), (math.asin(0.6), 0, None)),  # back where it came from
        ((0, 0.6, 0.8), (0, -0.6, 0.8), (0, math.asin(0.6), HALF_PI)),
        ((0, 0, 1), (1, 0, 0), (math.pi / 4, math.pi / 4, math.pi)),
        ((1, 0, 0), (0, 0, 1), (math.pi / 4, math.pi / 4, 0)),
    ],
)
def test_known_geometry(
    wi: tuple[float, ...], wo: tuple[float, ...], expected: tuple[float | None, ...]
):
    got = from_directions(angles_of(*wi), angles_of(*wo))
    assert bool(torch.isfinite(got).all())
    for value, wanted in zip(got.tolist(), expected, strict=True):
        if wanted is not None:
            assert abs(value) == pytest.approx(wanted, abs=1e-7)


def test_the_mirror_direction_has_its_half_vector_on_the_normal_whatever_the_azimuth():
    theta, phi = torch.rand(2, 500, generator=torch.Generator().manual_seed(0)) * 1.5
    wi = torch.stack((theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()), -1)
    wo = wi * torch.tensor((-1.0, -1.0, 1.0))
    angles = from_directions(wi, wo)
    assert float(angles[:, 0].max()) < 1e-6
    torch.testing.assert_close(angles[:, 1], theta, rtol=0, atol=1e-6)


def test_opposite_directions_give_finite_angles():
    angles = from_directions(angles_of(1, 0, 0), angles_of(-1, 0, 0))
    assert bool(torch.isfinite(angles).all())
    assert angles[0] == 0


@given(polar, polar, azimuth)
def test_cosines_are_the_dot_products(theta_h: float, theta_d: float, phi_d: float):
    angles = angles_of(theta_h, theta_d, phi_d)
    wi, wo = (w.numpy() for w in directions(angles))
    cos_i, cos_o, cos_h, cos_d = (float(c) for c in cosines(angles))
    half = np.array((math.sin(theta_h), 0, math.cos(theta_h)))
    assert cos_i == pytest.approx(wi[2], abs=1e-14)
    assert cos_o == pytest.approx(wo[2], abs=1e-14)
    assert cos_h == pytest.approx(half[2], abs=1e-14)
    assert cos_d == pytest.approx(wi @ half, abs=1e-14)
    assert cos_d == pytest.approx(wo @ half, abs=1e-14)


def test_above_the_horizon_means_both_directions():
    tilted = math.radians(60)
    cases = {
        (0.0, tilted, 0.0): True,  # mirror at 60 degrees
        (tilted, 0.0, 0.0): True,  # both at 60 degrees
        (tilted, math.radians(40), 0.0): False,  # wi at 100 degrees
        (tilted, math.radians(40), math.pi): False,  # wo at 100 degrees
        (tilted, math.radians(20), 0.0): True,  # wi at 80 degrees
    }
    angles = torch.tensor(list(cases))
    assert above_horizon(angles).tolist() == list(cases.values())
    # the last one has cos 80 degrees = 0.174
    assert above_horizon(angles[-1], margin=0.17)
    assert not above_horizon(angles[-1], margin=0.18)


@given(polar, polar, azimuth)
def test_the_network_input_is_reciprocal(theta_h: float, theta_d: float, phi_d: float):
    """Exchanging light and eye turns phi_d by pi and must leave the input as it is."""
    one = network_input(angles_of(theta_h, theta_d, phi_d))
    other = network_input(angles_of(theta_h, theta_d, phi_d + math.pi))
    np.testing.assert_allclose(one, other, atol=1e-14)
    np.testing.assert_allclose(one[2:], (math.sin(2 * phi_d), math.cos(2 * phi_d)), atol=1e-14)


def test_the_network_input_of_exchanged_directions():
    g = torch.Generator().manual_seed(3)
    angles = torch.rand(200, 3, generator=g, dtype=torch.float64) * angles_of(1.5, 1.5, 6)
    wi, wo = directions(angles[above_horizon(angles)])
    torch.testing.assert_close(
        network_input(from_directions(wi, wo)),
        network_input(from_directions(wo, wi)),
        rtol=0,
        atol=1e-9,
    )


def test_any_leading_shape():
    angles = torch.rand(2, 3, 4, 3)
    wi, wo = directions(angles)
    assert wi.shape == wo.shape == (2, 3, 4, 3)
    assert from_directions(wi, wo).shape == (2, 3, 4, 3)
    assert network_input(angles).shape == (2, 3, 4, 4)
    assert above_horizon(angles).shape == (2, 3, 4)
