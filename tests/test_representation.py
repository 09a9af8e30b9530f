"""Representations: what holds by construction, whatever was learned.

The bundled encoder may be trained again at any time; nothing here depends on its weights.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from safetensors.torch import load_file, save_file

from model_runtime.brdf import disney, torrance_sparrow
from model_runtime.brdf.half_angle import above_horizon, cosines, directions, from_directions
from model_runtime.errors import ModelFileError
from model_runtime.model_files.weights import ENCODER, hash_tensors, save_model
from model_runtime.representation import build, load_representation
from model_runtime.representation.latents import (
    Latents,
    inverse_log_transform,
    log_transform,
)
from model_runtime.representation.lobes import compress, expand
from model_runtime.representation.paper import PaperRepresentation

pytestmark = pytest.mark.usefixtures("one_thread")

KINDS = ["bundled", "lobes", "paper"]


@pytest.fixture(scope="module")
def models():
    torch.manual_seed(0)
    with torch.no_grad():
        yield {
            "bundled": load_representation()[0],
            "lobes": build("lobes").eval(),
            "paper": build("paper").eval(),
        }


@pytest.fixture(params=KINDS)
def model(request: pytest.FixtureRequest, models):
    with torch.no_grad():
        yield models[request.param]


@pytest.fixture(params=["bundled", "lobes"])
def lobes(request: pytest.FixtureRequest, models):
    with torch.no_grad():
        yield models[request.param]


def materials(angles: torch.Tensor, n: int = 6, seed: int = 0) -> torch.Tensor:
    """f [n + 4, M, 3]: Disney's, and mirrors, black and white."""
    g = torch.Generator().manual_seed(seed)
    drawn = [torch.rand(n, *shape, generator=g) for shape in ((3,), *[()] * 10)]
    simple = torrance_sparrow.evaluate(
        torch.tensor([[0.0] * 3, [0.0] * 3, [1.0] * 3, [0.1, 0.2, 0.7]]),
        torch.tensor([[0.9, 0.6, 0.3], [0.0] * 3, [0.0] * 3, [0.04] * 3]),
        torch.tensor([1e-4, 0.5, 1.0, 0.002]),
        angles,
    )
    return torch.cat((disney.evaluate(disney.DisneyParameters(*drawn), angles), simple))


def everywhere() -> torch.Tensor:
    """Directions [M, 3] from the mirror peak to the horizon and below it."""
    near = (0.0, 1e-7, 1e-4, 1e-3, 0.01, 0.1, 0.5, 1.0, 1.5, math.pi / 2)
    d = (0.0, 0.3, 1.0, 1.5, math.pi / 2)
    p = (0.0, 0.5, math.pi / 2, 2.0, math.pi)
    return torch.tensor(list(itertools.product(near, d, p)))


def visible(n: int = 300) -> torch.Tensor:
    g = torch.Generator().manual_seed(9)
    angles = torch.rand(4 * n, 3, generator=g) * torch.tensor((1.57, 1.57, 6.28))
    return angles[above_horizon(angles, margin=0.01)][:n]


def encoded(model, f_of=materials) -> Latents:
    angles = model.sample_angles(257)
    return model.encode(angles, f_of(angles))


def test_latents_have_the_sizes_that_are_declared(model):
    latents = encoded(model)
    color, shared = model.latent_sizes
    assert latents.color.shape == (10, 3, color // 3)
    assert latents.shared.shape == (10, shared)
    assert latents.flat().shape == (10, color + shared)
    assert model.decode(latents, visible()).shape == (10, len(visible()), 3)


def test_flat_and_back(model):
    latents = encoded(model)
    back = latents.unflat(latents.flat())
    assert torch.equal(back.color, latents.color)
    assert torch.equal(back.shared, latents.shared)
    # the flat layout is color first, then what is shared; histories become rows
    both = torch.stack((latents.flat(), 2 * latents.flat()), 1)
    assert torch.equal(latents.unflat(both).shared[1], 2 * latents.shared[0])


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 0, 1)])
def test_permuted_channels_permute_the_color_latents_and_nothing_else(model, order):
    one = encoded(model)
    other = encoded(model, lambda angles: materials(angles)[..., list(order)])
    torch.testing.assert_close(other.color, one.color[:, list(order)], rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(other.shared, one.shared, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 0, 1)])
def test_permuted_color_latents_decode_to_permuted_channels(lobes, order):
    latents = encoded(lobes)
    permuted = Latents(latents.color[:, list(order)], latents.shared)
    f = lobes.decode(latents, visible())
    again = lobes.decode(permuted, visible())
    torch.testing.assert_close(again, f[..., list(order)], rtol=1e-4, atol=1e-6)


def test_a_gray_material_decodes_to_gray(lobes):
    latents = encoded(lobes, lambda angles: materials(angles)[..., :1].expand(-1, -1, 3))
    f = lobes.decode(latents, visible())
    torch.testing.assert_close(f[..., 0], f[..., 1], rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(f[..., 0], f[..., 2], rtol=1e-4, atol=1e-6)


def test_light_and_eye_may_be_exchanged(model):
    latents = encoded(model)
    wi, wo = (w.float() for w in directions(visible().double()))
    forth = model.decode(latents, from_directions(wi, wo))
    back = model.decode(latents, from_directions(wo, wi))
    torch.testing.assert_close(back, forth, rtol=2e-3, atol=1e-4)


def test_finite_and_not_negative_everywhere(model):
    f = model.decode(encoded(model), everywhere())
    assert bool(torch.isfinite(f).all())
    assert float(f.min()) >= 0


@pytest.mark.parametrize("size", [1e2, 1e6])
def test_latents_that_ran_away_still_decode(model, size: float):
    """A rollout may leave what was trained on; a picture must not get holes."""
    latents = encoded(model)
    g = torch.Generator().manual_seed(3)
    wild = size * torch.randn(20, latents.flat().shape[1], generator=g)
    f = model.decode(latents.unflat(wild), everywhere())
    assert bool(torch.isfinite(f).all())
    assert float(f.min()) >= 0


def test_what_a_measurement_may_hold_can_be_encoded(model):
    """Peaks beyond any real one, negative noise, and (for the lobes) gaps."""
    angles = model.sample_angles(257)
    f = materials(angles)
    f[0] *= 1e8
    f[1] -= 0.5
    if model.name == "lobes":
        f[2, 3] = math.nan
    latents = model.encode(angles, f)
    assert bool(torch.isfinite(latents.flat()).all())
    assert bool(torch.isfinite(model.decode(latents, visible())).all())


def test_batches_and_threads_change_nothing(model):
    angles = model.sample_angles(257)
    f = materials(angles, n=30)
    whole = model.encode(angles, f)
    out = model.decode(whole, visible())
    parts = [model.encode(angles, part) for part in f.split(5)]
    flat = torch.cat([part.flat() for part in parts])
    scale = whole.flat().abs().max()
    torch.testing.assert_close(flat / scale, whole.flat() / scale, rtol=1e-5, atol=1e-6)
    decoded = torch.cat([model.decode(whole.unflat(z), visible()) for z in whole.flat().split(5)])
    torch.testing.assert_close(decoded, out, rtol=1e-5, atol=1e-6)
    torch.set_num_threads(2)
    torch.testing.assert_close(model.decode(whole, visible()), out, rtol=1e-5, atol=1e-6)


def test_equal_texels_are_equal_wherever_they_stand_in_a_batch(model):
    angles = model.sample_angles(257)
    f = materials(angles)[:1].expand(9, -1, -1)
    flat = model.encode(angles, f).flat()
    torch.testing.assert_close(flat, flat[:1].expand_as(flat), rtol=1e-5, atol=1e-6)


class TestLobes:
    @pytest.mark.parametrize("m", [1, 16, 257])
    def test_fewer_samples_are_the_first_of_the_more(self, m: int):
        model = build("lobes")
        assert torch.equal(model.sample_angles(m), model.sample_angles(16_200)[:m])

    def test_every_direction_is_there_once_and_above_the_horizon(self):
        angles = build("lobes").sample_angles(16_200)
        assert len(torch.unique(angles, dim=0)) == len(angles) == 258
        assert bool(above_horizon(angles).all())

    def test_a_sample_that_was_not_taken_is_one_that_is_missing(self, lobes):
        angles = lobes.sample_angles(16_200)
        f = materials(angles)
        few = lobes.encode(angles[:40], f[:, :40]).flat()
        f[:, 40:] = math.nan
        assert torch.equal(lobes.encode(angles, f).flat(), few)

    def test_the_order_of_samples_does_not_matter(self, lobes):
        angles = lobes.sample_angles(16_200, measured=True)
        f, order = materials(angles), torch.randperm(len(angles))
        one, other = lobes.encode(angles, f), lobes.encode(angles[order], f[:, order])
        assert torch.equal(one.flat(), other.flat())

    def test_a_measurement_is_not_asked_near_grazing(self, lobes):
        cos_i, cos_o, _, _ = cosines(lobes.sample_angles(16_200, measured=True))
        assert float(torch.minimum(cos_i, cos_o).min()) >= 0.2

    def test_a_firefly_is_as_good_as_missing(self, lobes):
        angles = lobes.sample_angles(16_200)
        f = materials(angles)
        bright, missing = f.clone(), f.clone()
        bright[:, 200], missing[:, 200] = 1e4, math.nan
        assert torch.equal(
            lobes.encode(angles, bright).flat(), lobes.encode(angles, missing).flat()
        )

    @pytest.mark.parametrize("alpha", [1e-4, 1e-3, 0.01, 0.1])
    def test_a_mirror_is_no_firefly(self, lobes, alpha: float):
        angles = lobes.sample_angles(16_200)
        f = torrance_sparrow.evaluate(
            torch.zeros(1, 3), torch.ones(1, 3), torch.tensor([alpha]), angles
        )
        known = torch.ones(1, 3, len(angles), dtype=torch.bool)
        assert not bool(lobes._fireflies(f.transpose(1, 2), known).any())

    def test_a_channel_that_is_missing_leaves_no_trace_in_the_pool(self, lobes):
        """Whatever stands in it, and however large."""
        angles = lobes.sample_angles(16_200)
        f = materials(angles)
        one, other = f.clone(), f.clone()
        one[..., 1], other[..., 1] = math.nan, math.inf
        assert torch.equal(lobes.encode(angles, one).flat(), lobes.encode(angles, other).flat())

    def test_nothing_known_is_still_a_material(self, lobes):
        angles = lobes.sample_angles(16_200)
        latents = lobes.encode(angles, torch.full((2, len(angles), 3), math.nan))
        assert bool(torch.isfinite(lobes.decode(latents, visible())).all())

    @pytest.mark.parametrize("order", [(1, 0, 2), (2, 0, 1)])
    def test_parameters_of_permuted_channels(self, lobes, order):
        g = torch.Generator().manual_seed(2)
        states = torch.rand(9, 7, generator=g)
        permuted = torch.cat(
            (states[:, list(order)], states[:, 3:6][:, list(order)], states[:, 6:]), 1
        )
        one, other = (lobes.encode_parameters(s) for s in (states, permuted))
        torch.testing.assert_close(other.color, one.color[:, list(order)], rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(other.shared, one.shared, rtol=1e-4, atol=1e-5)

    @pytest.mark.parametrize(
        ("kd", "ks", "alpha"), [(0, 0, 0), (1e6, 1e6, 10), (0.5, 1e-9, 1e-9), (-0.1, -1, -1)]
    )
    def test_parameters_out_of_range_give_latents(self, lobes, kd, ks, alpha):
        latents = lobes.encode_parameters(torch.tensor([[kd] * 3 + [ks] * 3 + [alpha]]))
        assert bool(torch.isfinite(latents.flat()).all())


class TestJoint:
    """BRDFNPs, the ablation: nothing is split by channel, so nothing is said about permutations."""

    def test_all_latents_are_shared(self):
        torch.manual_seed(1)
        model = build("brdfnps").eval()
        assert model.latent_sizes == (0, 10)
        latents = encoded(model)
        assert latents.color.shape == (10, 3, 0)
        assert latents.flat().shape == (10, 10)
        assert torch.equal(latents.unflat(latents.flat()).shared, latents.shared)
        assert model.decode(latents, visible()).shape == (10, len(visible()), 3)

    def test_it_sees_the_channels_in_their_order(self):
        torch.manual_seed(1)
        model = build("brdfnps").eval()
        one, other = (
            encoded(model, lambda a, o=o: materials(a)[..., o]) for o in ([0, 1, 2], [2, 1, 0])
        )
        assert not torch.allclose(one.shared, other.shared, rtol=1e-3)


class TestPaper:
    def test_z_rgb_is_the_channel_median_of_the_transformed_values(self):
        model = PaperRepresentation().eval()
        angles = model.sample_angles(101)
        assert angles.shape == (101, 3)
        f = materials(angles)
        with torch.no_grad():
            color = model.encode(angles, f).color
        stretched = f.double().numpy()
        for _ in range(4):
            stretched = np.log(1 + stretched)
        np.testing.assert_allclose(color[..., 0], np.median(stretched, 1), rtol=1e-5, atol=1e-7)

    def test_more_samples_begin_with_the_fewer_ones(self):
        model = PaperRepresentation()
        assert torch.equal(model.sample_angles(50), model.sample_angles(50))
        assert bool(above_horizon(model.sample_angles(2000)).all())

    def test_the_order_of_samples_does_not_matter(self):
        torch.manual_seed(1)
        model = PaperRepresentation().eval()
        angles = model.sample_angles(101)
        f, order = materials(angles), torch.randperm(101)
        with torch.no_grad():
            one = model.encode(angles, f)
            other = model.encode(angles[order], f[:, order])
        torch.testing.assert_close(other.flat(), one.flat(), rtol=1e-4, atol=1e-5)

    def test_training_draws_from_the_normal_distribution_and_use_does_not(self):
        torch.manual_seed(1)
        model = PaperRepresentation()
        angles = model.sample_angles(33)
        f = materials(angles)
        with torch.no_grad():
            drawn = [model.train().encode(angles, f).shared for _ in range(2)]
            means = [model.eval().encode(angles, f).shared for _ in range(2)]
        assert not torch.equal(*drawn)
        assert torch.equal(*means)


@given(st.floats(0, 2e4))
def test_the_log_transform_and_its_inverse(a: float):
    """Equation 1 by hand, and back; up to e^10 - 1 = 22025 nothing is clamped."""
    by_hand = math.log(1 + math.log(1 + math.log(1 + math.log(1 + a))))
    wide = torch.tensor(a, dtype=torch.float64)
    assert log_transform(wide).item() == pytest.approx(by_hand, rel=1e-12, abs=1e-12)
    assert inverse_log_transform(log_transform(wide)).item() == pytest.approx(a, rel=1e-9)
    single = inverse_log_transform(log_transform(torch.tensor(a))).item()
    assert single == pytest.approx(a, rel=2e-3, abs=1e-6)


def test_the_inverse_never_overflows():
    f = inverse_log_transform(torch.tensor([0.8, 1.0, 3.0, 50.0, 1e30]))
    assert bool(torch.isfinite(f).all())
    assert float(f.max()) == pytest.approx(math.expm1(10), rel=1e-3)


@given(st.floats(0, 1e4))
def test_compressing_and_expanding(a: float):
    by_hand = math.log(1 + a / 0.01)
    wide = torch.tensor(a, dtype=torch.float64)
    assert compress(wide).item() == pytest.approx(by_hand, rel=1e-12, abs=1e-12)
    assert expand(compress(wide)).item() == pytest.approx(a, rel=1e-9, abs=1e-12)


class TestFiles:
    def test_saved_and_loaded_it_is_the_same(self, tmp_path: Path):
        torch.manual_seed(4)
        model = build("lobes").eval().requires_grad_(False)
        path = tmp_path / "encoder.safetensors"
        save_model(path, model.state_dict(), {"name": "lobes"}, kind="encoder")
        again, identity = load_representation(path)
        assert identity == hash_tensors(model.state_dict())
        angles = model.sample_angles(1)
        one, other = (m.encode(angles, materials(angles)).flat() for m in (model, again))
        assert torch.equal(one, other)
        assert not any(p.requires_grad for p in again.parameters())

    def test_another_kind_is_refused(self, tmp_path: Path):
        path = tmp_path / "encoder.safetensors"
        save_model(path, {"w": torch.zeros(1)}, {"name": "quantum"}, kind="encoder")
        with pytest.raises(ModelFileError, match="unknown here"):
            load_representation(path)

    def test_weights_of_other_shapes_are_refused(self, tmp_path: Path):
        path = tmp_path / "encoder.safetensors"
        state = build("lobes").state_dict() | {"basis.0.weight": torch.zeros(3, 3)}
        save_model(path, state, {"name": "lobes"}, kind="encoder")
        with pytest.raises(ModelFileError, match="does not fit"):
            load_representation(path)

    def test_a_flipped_weight_is_another_encoder(self, tmp_path: Path):
        """So an NTM that was trained for it is refused (test_temporal)."""
        tensors = load_file(ENCODER)
        before = hash_tensors(tensors)
        first = sorted(tensors)[0]
        tensors[first].view(-1)[0] += 1
        save_file(tensors, tmp_path / "x.safetensors")
        assert hash_tensors(load_file(tmp_path / "x.safetensors")) != before
