"""Parameters told from latents, without decoding and fitting them."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from model_runtime.brdf.fit import fit_angles, fit_torrance_sparrow
from model_runtime.errors import ModelFileError
from model_runtime.model_files.weights import (
    ENCODER,
    ESTIMATOR,
    find_model,
    list_models,
    load_model,
    read_card,
)
from model_runtime.modelling.palette import appearance_psnr
from model_runtime.representation import load_representation
from model_runtime.representation.estimator import ParameterEstimator, load_estimator
from model_runtime.representation.latents import Latents
from model_runtime.temporal.ntm import NeuralTemporalModel
from tests.trainings import equal, kill_at
from training.distillation import random_states
from training.estimator import train_estimator

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def bundled():
    representation, identity = load_representation()
    return representation, load_estimator(identity)


def states(n: int, seed: int = 0) -> torch.Tensor:
    return random_states(n, torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("ntm", [None, "rust", "char", "patina"])
def test_it_tells_what_the_fit_finds(bundled, ntm: str | None):
    """Of most materials nearly the same; of the oddest fifth, far from all textures, less so."""
    representation, estimator = bundled
    latents = representation.encode_parameters(states(300, seed=99))
    if ntm is not None:
        model = NeuralTemporalModel.load(find_model(ntm), load_representation()[1])
        latents = latents.unflat(model.latents.rollout(latents.flat(), 4).flatten(0, 1))
    angles = fit_angles()
    fitted = fit_torrance_sparrow(representation.decode(latents, angles), angles).parameters()
    pairs = zip(fitted[:, None], estimator.parameters_of(latents)[:, None], strict=True)
    found = torch.tensor([appearance_psnr(*pair) for pair in pairs])
    assert found.median() > 50
    assert found.quantile(0.2) > 40


def test_channels_are_treated_alike(bundled):
    representation, estimator = bundled
    latents = representation.encode_parameters(states(9))
    turned = Latents(latents.color.roll(1, 1), latents.shared)
    here, there = (estimator.parameters_of(each) for each in (latents, turned))
    torch.testing.assert_close(here[:, :3].roll(1, 1), there[:, :3])
    torch.testing.assert_close(here[:, 3:6].roll(1, 1), there[:, 3:6])
    torch.testing.assert_close(here[:, 6], there[:, 6])


@pytest.mark.parametrize("size", [0.0, 1.0, 1e3, 1e6])
def test_what_it_tells_can_be_rendered(bundled, size: float):
    g = torch.Generator().manual_seed(1)
    color, shared = torch.randn(50, 3, 4, generator=g), torch.randn(50, 12, generator=g)
    told = bundled[1].parameters_of(Latents(size * color, size * shared))
    assert told.isfinite().all()
    assert (told[:, :6] >= 0).all()
    assert ((told[:, 6] >= 1e-4 - 1e-9) & (told[:, 6] <= 1)).all()


def test_that_of_another_encoder_is_refused():
    with pytest.raises(ModelFileError, match="belongs to another encoder"):
        load_estimator("0123456789abcdef")
    with pytest.raises(ModelFileError, match="holds an encoder, not an estimator"):
        load_estimator(load_representation()[1], ENCODER)


def test_it_is_no_model_that_an_artist_can_choose():
    assert ESTIMATOR.stat().st_size < 1 << 20
    assert ESTIMATOR not in {card.path for card in list_models()}


TINY = {"encoder": ENCODER, "materials": 600}


def test_training_makes_a_file_that_loads(tmp_path: Path):
    path = tmp_path / "e.estimator.safetensors"
    train_estimator(output=path, minutes=0.02, seed=3, **TINY)
    identity = load_representation()[1]
    assert isinstance(load_estimator(identity, path), ParameterEstimator)
    card = read_card(path)
    assert (card.kind, card.representation) == ("estimator", identity)
    assert card.trained["command"].endswith("--seed 3 --minutes 0.02")
    assert card.trained["iterations"] > 0


def test_killed_and_resumed_it_ends_as_it_would_have(tmp_path: Path):
    whole, parts = tmp_path / "whole.safetensors", tmp_path / "parts.safetensors"
    train_estimator(output=whole, iterations=14, **TINY)
    for at in (2, 2):
        kill_at(at, lambda: train_estimator(output=parts, iterations=14, resume=True, **TINY))
        assert not parts.exists()
    train_estimator(output=parts, iterations=14, resume=True, **TINY)
    assert equal(whole, parts)
    assert not list(tmp_path.glob("*checkpoint*"))


def test_training_is_repeatable_and_learns(tmp_path: Path):
    def trained(name: str, **options) -> dict[str, torch.Tensor]:
        path = train_estimator(output=tmp_path / name, **options, **TINY)
        return load_model(path, "estimator")[0]

    once, again = (trained(name, iterations=30) for name in ("once", "again"))
    assert all(torch.equal(once[name], again[name]) for name in once)
    other = trained("other", iterations=30, seed=1)
    assert not all(torch.equal(once[name], other[name]) for name in once)
    representation, _ = load_representation()
    latents, angles = representation.encode_parameters(states(200)), fit_angles()
    fitted = fit_torrance_sparrow(representation.decode(latents, angles), angles).parameters()
    found = []
    for name, iterations in (("little", 5), ("more", 300)):
        model = ParameterEstimator().requires_grad_(False)
        model.load_state_dict(trained(name, iterations=iterations))
        found.append(appearance_psnr(fitted, model.parameters_of(latents)))
    assert found[1] > found[0] + 3
