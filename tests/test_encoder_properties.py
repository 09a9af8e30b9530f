"""What the bundled encoder promises beside accuracy, and that the measures of it are right."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from model_runtime.brdf.half_angle import above_horizon, cosines, from_directions
from model_runtime.representation import Trained, build, load_representation
from tests.drawn_materials import drawn
from training.evaluation.representation import damages, properties
from training.evaluation.representation.probes import (
    Group,
    analytic_groups,
    measured_groups,
    reflecting,
    together,
)
from training.metric.albedo import INCIDENCES, Albedos
from training.metric.sphere import Sphere

pytestmark = pytest.mark.usefixtures("one_thread")

SEEDS = st.integers(0, 2**31)
ALPHAS = torch.tensor((1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1.0))


@pytest.fixture(scope="module")
def model() -> Iterator[Trained]:
    with torch.no_grad():
        yield load_representation()[0]


@pytest.fixture(scope="module")
def analytic() -> Group:
    return together(analytic_groups())


@pytest.fixture(scope="module")
def measured(data_folder: Path) -> Group:
    return together(measured_groups(data_folder))


@pytest.fixture(scope="module")
def sphere(data_folder: Path) -> Sphere:
    return Sphere.load(data_folder / "hdri", pixels=16, height=16, width=32)


class TestColorPermutation:
    """It permutes the color latents and the decoded channels, and changes nothing else."""

    def check(self, model: Trained, group: Group) -> None:
        changes = properties.color_permutation(model, group)
        for name in ("shared", "color", "decoded"):
            assert changes[name] < 1e-5, name
            assert changes[f"exact_{name}"] < 1e-11, name

    @settings(max_examples=5, deadline=None)
    @given(SEEDS)
    def test_of_any_material(self, model: Trained, seed: int):
        self.check(model, drawn(seed))

    def test_of_mirrors_white_and_black(self, model: Trained, analytic: Group):
        self.check(model, analytic)

    def test_of_measured_materials(self, model: Trained, measured: Group):
        self.check(model, measured)

    def test_what_depends_on_the_order_is_noticed(self, analytic: Group):
        """BRDFNPs has no color latents: all that it knows changes."""
        torch.manual_seed(0)
        joint = build("brdfnps").eval().requires_grad_(False)
        assert properties.color_permutation(joint, analytic.first(4))["exact_shared"] > 0.01


class TestReciprocity:
    """Light and eye may be exchanged: exactly, so that double precision leaves nothing."""

    @settings(max_examples=5, deadline=None)
    @given(SEEDS)
    def test_of_any_material(self, model: Trained, seed: int):
        found = properties.reciprocity(model, drawn(seed))
        assert found["single"] < 2e-5
        assert found["exact"] < 1e-8

    def test_of_mirrors_white_and_black(self, model: Trained, analytic: Group):
        found = properties.reciprocity(model, analytic)
        assert found["single"] < 2e-5
        assert found["exact"] < 1e-8


class TestRange:
    """Finite and not negative, from mirror peaks to 89.9 degrees."""

    def test_the_grid_reaches_both(self):
        angles = properties.everywhere().double()
        cos_i, cos_o, _, _ = cosines(angles)
        assert bool(above_horizon(angles).all())
        lowest = torch.maximum(cos_i.acos(), cos_o.acos()).rad2deg().max()
        assert float(lowest) == pytest.approx(89.9, abs=0.01)
        assert int((angles[:, 0] < 1e-7).sum()) >= 8

    @settings(max_examples=5, deadline=None)
    @given(SEEDS)
    def test_of_any_material(self, model: Trained, seed: int):
        found = properties.range_of_values(model, drawn(seed))
        assert found["finite"] and found["min"] >= 0

    def test_of_mirrors_white_and_black(self, model: Trained, analytic: Group):
        found = properties.range_of_values(model, analytic)
        assert found["finite"] and found["min"] >= 0

    def test_of_measured_materials(self, model: Trained, measured: Group):
        found = properties.range_of_values(model, measured)
        assert found["finite"] and found["min"] >= 0


class TestAlbedos:
    """The quadrature, against results worked out otherwise."""

    def test_of_a_lambertian(self):
        found = Albedos.of(lambda angles: torch.full((1, len(angles), 3), 0.7 / math.pi))
        torch.testing.assert_close(found.directional, torch.full((1, len(INCIDENCES), 3), 0.7))
        torch.testing.assert_close(found.diffuse, torch.full((1, 3), 0.7))

    def test_of_unshadowed_mirrors_seen_along_the_normal(self):
        """GGX without G reflects what lies within 45 degrees: the integral of D cos is
        1 / (1 + alpha^2) in closed form.
        """

        def unshadowed(angles: torch.Tensor) -> torch.Tensor:
            cos_i, cos_o, _, _ = cosines(angles)
            sin2, a2 = angles[:, 0].sin().square(), ALPHAS[:, None].square()
            density = a2 / (math.pi * (sin2 + a2 * (1 - sin2)).square())
            return (density / (4 * cos_i * cos_o))[..., None].expand(-1, -1, 3)

        found = Albedos.of(unshadowed).directional[:, 0, 0]
        torch.testing.assert_close(found, 1 / (1 + ALPHAS.square()), rtol=1e-4, atol=0)

    def test_of_a_rough_metal_added_up_over_the_sphere(self):
        alpha, theta_i = 0.3, math.radians(60)
        polar = (np.arange(1000) + 0.5) * np.pi / 2000
        turn = (np.arange(1000) + 0.5) * np.pi / 1000
        sin_o, phi = np.meshgrid(np.sin(polar), turn, indexing="ij")
        cos_o = np.cos(polar)[:, None] + 0 * phi
        wi = np.array((math.sin(theta_i), 0, math.cos(theta_i)))
        wo = np.stack((sin_o * np.cos(phi), sin_o * np.sin(phi), cos_o), -1)
        half = (wi + wo) / np.linalg.norm(wi + wo, axis=-1, keepdims=True)
        density = alpha**2 / (np.pi * (half[..., 2] ** 2 * (alpha**2 - 1) + 1) ** 2)
        masking = [2 / (1 + np.sqrt(1 + alpha**2 * (1 / c**2 - 1))) for c in (wi[2], cos_o)]
        f = density * masking[0] * masking[1] / (4 * wi[2] * cos_o)
        expected = 2 * (f * cos_o * sin_o).sum() * (np.pi / 2000) * (np.pi / 1000)
        metal = reflecting(("",), torch.zeros(1, 3), torch.ones(1, 3), torch.tensor([alpha]))
        found = Albedos.of(metal.evaluate).directional[0, INCIDENCES.index(60.0), 0]
        assert float(found) == pytest.approx(expected, rel=1e-4)

    def test_has_converged(self, analytic: Group, measured: Group):
        for group in (analytic, measured):
            one = Albedos.of(group.evaluate)
            other = Albedos.of(group.evaluate, rings=80, turns=96)
            torch.testing.assert_close(one.directional, other.directional, rtol=0, atol=5e-3)
            torch.testing.assert_close(one.diffuse, other.diffuse, rtol=0, atol=1e-3)


class TestEnergy:
    """Decoding adds at most 2 % to what the input gives back."""

    @pytest.mark.parametrize("kind", ["torrance_sparrow", "mirrors", "black"])
    def test_from_every_direction(self, model: Trained, kind: str):
        assert properties.energy(model, analytic_groups()[kind])["excess"] < 0.02

    @pytest.mark.parametrize(("kind", "excess"), [("disney", 0.06), ("bright", 0.1)])
    def test_at_85_degrees_more_is_known_to_be_added(
        self, model: Trained, kind: str, excess: float
    ):
        """Of retroreflection, and of materials that give back more than they get."""
        found = properties.energy(model, analytic_groups()[kind])
        assert found["excess"] < excess
        assert found["at"].endswith("85 degrees")

    @pytest.mark.parametrize("kind", ["torrance_sparrow", "mirrors", "black", "disney", "bright"])
    def test_from_everywhere_at_once(self, model: Trained, kind: str):
        found = properties.energy(model, analytic_groups()[kind])
        assert found["diffuse_excess_relative"] < 0.02

    def test_of_measured_materials(self, model: Trained, measured: Group):
        """Unseen ones are not known that well near grazing, where single directions exceed 2 %;
        most directions, and light from everywhere, must not.
        """
        found = properties.energy(model, measured)
        assert found["mean"] < 0.02
        assert found["over_two_percent"] < 0.35
        assert found["diffuse_excess"] < 0.04

    def test_added_light_is_noticed(self, analytic: Group):
        """A decoder of twice the light exceeds by as much as the input's albedo."""

        class Brighter:
            name = "brighter"

            def sample_angles(self, m: int, *, measured: bool = False) -> torch.Tensor:
                return torch.zeros(1, 3)

            def encode(self, angles: torch.Tensor, f: torch.Tensor) -> None:
                return None

            def decode(self, latents: None, angles: torch.Tensor) -> torch.Tensor:
                return 2 * analytic.evaluate(angles)

        found = properties.energy(Brighter(), analytic)  # pyright: ignore[reportArgumentType]
        assert found["excess_relative"] == pytest.approx(1, abs=1e-5)
        assert found["diffuse_excess"] > 1


@pytest.mark.parametrize("kind", ["analytic", "measured"])
def test_batches_and_threads_change_nothing(
    model: Trained, kind: str, request: pytest.FixtureRequest
):
    found = properties.agreement(model, request.getfixturevalue(kind))
    assert found["latents"] < 1e-5
    assert found["decoded"] < 1e-5


def test_parameters_are_as_good_as_samples(model: Trained, sphere: Sphere):
    found = properties.short_cut(model, sphere)
    assert found["short"] > found["sampled"] - 6
    assert found["short_min"] > 40


def test_latents_of_similar_materials_are_near(model: Trained, sphere: Sphere):
    assert properties.neighborhood(model, sphere)["rank_correlation"] > 0.6


def test_distances_that_mean_nothing_do_not_correlate(sphere: Sphere):
    """Of an encoder that was never trained."""

    class Anything:
        name = "anything"

        def sample_angles(self, m: int, *, measured: bool = False) -> torch.Tensor:
            return from_directions(torch.eye(3)[2:], torch.eye(3)[2:])

        def encode(self, angles: torch.Tensor, f: torch.Tensor) -> damages.Latents:
            g = torch.Generator().manual_seed(2)
            noise = torch.randn(len(f), 12, generator=g)
            return damages.Latents(noise.new_zeros(len(f), 3, 0), noise)

    found = properties.neighborhood(Anything(), sphere)  # pyright: ignore[reportArgumentType]
    assert abs(found["rank_correlation"]) < 0.2


def test_everything_is_ready_for_json(model: Trained, data_folder: Path):
    """Few pixels: the shape of the report, not its numbers."""
    report = properties.measure_properties(model, data_folder, pixels=4)
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert set(report) == {
        "color_permutation",
        "reciprocity",
        "range",
        "energy",
        "agreement",
        "neighborhood",
        "short_cut",
        "stability",
    }
