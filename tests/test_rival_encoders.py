"""DeepBRDF and HyperBRDF: what they read, what they promise, and that they train."""

from __future__ import annotations

import math

import pytest
import torch

from model_runtime.brdf.half_angle import above_horizon, from_directions
from model_runtime.model_files.weights import read_card
from tests.trainings import equal, kill_at, small
from training.baselines.deepbrdf import DeepBRDF, around
from training.baselines.encoders import Encoder, build_encoder, load_encoder
from training.baselines.hyperbrdf import HyperBRDF
from training.data.analytic import random_torrance_sparrow
from training.encoder import CONFIGS, train_encoder
from training.evaluation.bench.encoders import RECIPES, WEIGHTS
from training.evaluation.representation.damages import read_what_is_there
from training.evaluation.representation.probes import Group, reflecting
from training.evaluation.representation.properties import everywhere

RIVALS = ("deepbrdf", "hyperbrdf")


@pytest.fixture(params=RIVALS)
def model(request: pytest.FixtureRequest) -> Encoder:
    torch.manual_seed(0)
    return build_encoder(request.param).eval().requires_grad_(False)


def some(n: int = 3) -> Group:
    return reflecting(("",) * n, *random_torrance_sparrow(n, torch.Generator().manual_seed(1)))


def test_what_is_decoded_is_finite_and_not_negative(model: Encoder):
    f = model.decode(some().encoded(model), everywhere())
    assert f.shape == (3, len(everywhere()), 3)
    assert bool(f.isfinite().all()) and float(f.min()) >= 0


def test_parameters_are_encoded_as_their_samples(model: Encoder):
    kd, ks, alpha = random_torrance_sparrow(3, torch.Generator().manual_seed(1))
    short = model.encode_parameters(torch.cat((kd, ks, alpha[:, None]), 1))
    angles = model.sample_angles(256)
    torch.testing.assert_close(short.shared, model.encode(angles, some().evaluate(angles)).shared)
    assert short.flat().shape == (3, sum(model.latent_sizes))


def test_the_table_lies_above_the_horizon_and_reaches_peak_and_grazing():
    angles = DeepBRDF().encoder_angles
    assert bool(above_horizon(angles, margin=1e-4).all())
    assert float(angles[:, 0].min()) == 0
    assert float(angles[:, 0].max()) > math.radians(85) < float(angles[:, 1].max())


def test_between_the_table_s_entries_logarithms_are_a_line():
    """What is linear in the table's own coordinates comes back, from whichever side it is read."""
    g = torch.Generator().manual_seed(2)
    u = torch.rand(200, 3, generator=g)
    quarter = math.pi / 2
    angles = torch.stack((u[:, 0].square() * quarter, u[:, 1] * quarter, u[:, 2] * quarter), 1)
    grid = torch.cartesian_prod(*(torch.linspace(0, 1, n) for n in (32, 16, 6)))
    for turned in (1, -1):  # mirrored
        for half_turn in (0, math.pi):  # light and eye exchanged
            seen = angles * torch.tensor((1, 1, turned)) + torch.tensor((0, 0, half_turn))
            entries, shares = around(seen)
            found = (grid[entries] * shares[..., None]).sum(1)
            torch.testing.assert_close(found, u, atol=2e-5, rtol=0)


def test_deepbrdf_is_reciprocal():
    torch.manual_seed(0)
    model = DeepBRDF().eval().requires_grad_(False)
    wi, wo = torch.nn.functional.normalize(torch.rand(2, 50, 3) + 0.05, dim=-1)
    latents = some().encoded(model)
    forth, back = (model.decode(latents, from_directions(*w)) for w in ((wi, wo), (wo, wi)))
    torch.testing.assert_close(forth, back, rtol=1e-3, atol=1e-5)


def test_deepbrdf_needs_every_entry():
    model = DeepBRDF().eval().requires_grad_(False)
    angles = model.sample_angles(16)
    f = some().evaluate(angles)
    assert read_what_is_there(model, angles, f) is not None
    f[:, 5:] = torch.nan
    assert read_what_is_there(model, angles, f) is None


def test_hyperbrdf_takes_samples_in_any_order_and_number():
    torch.manual_seed(0)
    model = HyperBRDF().eval().requires_grad_(False)
    angles = model.sample_angles(100)
    f, order = some().evaluate(angles), torch.randperm(100)
    latents = model.encode(angles, f)
    torch.testing.assert_close(latents.shared, model.encode(angles[order], f[:, order]).shared)
    twice = model.encode(torch.cat((angles, angles)), torch.cat((f, f), 1))
    torch.testing.assert_close(latents.shared, twice.shared)


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize("name", RIVALS)
def test_killed_and_resumed_they_end_as_they_would_have(data_folder, tmp_path, monkeypatch, name):
    monkeypatch.setitem(CONFIGS, name, small(name, batch=4, iterations=6))
    whole, parts = tmp_path / "whole.safetensors", tmp_path / "parts.safetensors"
    train_encoder(config=name, output=whole, seed=3)
    kill_at(2, lambda: train_encoder(config=name, output=parts, seed=3, resume=True))
    train_encoder(config=name, output=parts, seed=3, resume=True)
    assert equal(whole, parts)
    assert load_encoder(whole).name == name


@pytest.mark.parametrize("name", RIVALS)
def test_what_is_bundled_says_how_it_was_trained(name: str):
    path = WEIGHTS / f"{name}.safetensors"
    trained = read_card(path).trained
    assert load_encoder(path).name == name
    assert f"--config {RECIPES[name]} " in f"{trained['command']} "
    assert {"seed", "minutes", "data", "iterations", "held_out"} <= set(trained)
    assert path.stat().st_size < 5e6
