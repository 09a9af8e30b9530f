"""The bundled models of change, run ten times longer than trained, from anything at all."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from model_runtime.channels import ALPHA_MIN
from model_runtime.errors import ModelFileError
from model_runtime.model_files.weights import MODELS, list_models
from model_runtime.modelling.palette import viewing_angles
from model_runtime.modelling.rollout import roll_out
from model_runtime.representation import load_representation
from model_runtime.representation.latents import Latents
from model_runtime.temporal.models import LatentLSTM, ParameterLSTM
from model_runtime.temporal.ntm import NeuralTemporalModel

COUNT = 10_000
LIMIT = ParameterLSTM.LIMIT + 1e-3
FITTED = 12
BRIGHTEST = 3.0
"""Albedo that no rollout exceeds of materials that reflect at most all light."""


@pytest.fixture(scope="module")
def materials() -> Tensor:
    """States [10000, 7] of every color, gloss and metalness; Kd + Ks at most 1."""
    g = torch.Generator().manual_seed(0)
    states = torch.rand(COUNT, 7, generator=g)
    albedo = (states[:, :3] + states[:, 3:6]).amax(1, keepdim=True).clamp_min(1)
    return torch.cat((states[:, :6] / albedo, 10 ** (-4 * states[:, 6:])), 1)


@pytest.mark.parametrize("name", [card.name for card in list_models((MODELS,))])
class TestTenTimesLonger:
    @torch.inference_mode()
    def test_on_parameters(self, name: str, materials: Tensor):
        ntm, representation = _load(name)
        check(roll_out(materials, ntm, "lstm_parameters", representation).states)

    @torch.inference_mode()
    def test_on_latents(self, name: str, materials: Tensor):
        """Latents of all, and of some what textures would hold."""
        ntm, representation = _load(name)
        first = representation.encode_parameters(materials)
        last = ntm.latents.rollout(first.flat(), ntm.frames)[:, -1]
        assert bool((((last - ntm.latents.mean) / ntm.latents.scale).abs() <= LIMIT).all())
        color, _ = representation.latent_sizes
        latents = Latents(last[:, :color].reshape(COUNT, 3, -1), last[:, color:])
        assert bool(torch.isfinite(representation.decode(latents, viewing_angles())).all())
        check(roll_out(materials[:FITTED], ntm, "lstm_latents", representation).states)


class TestModelsThatLeadNowhere:
    """Weights that are numbers make states that are none, or latents of another encoder."""

    @pytest.mark.parametrize("rung", ["affine", "lstm_parameters", "lstm_latents"])
    @pytest.mark.parametrize("value", [torch.nan, torch.inf])
    def test_not_finite(self, materials: Tensor, rung: str, value: float):
        ntm, representation = _load("rust")

        class Lost:
            def rollout(self, state: Tensor, frames: int) -> Tensor:
                return torch.full((len(state), frames, state.shape[1]), value)

            sizes = ntm.latents.sizes

        name = rung.removeprefix("lstm_")
        with pytest.raises(ModelFileError, match=r"rust\.safetensors makes .* not finite"):
            roll_out(materials[:3], replace(ntm, **{name: Lost()}), rung, representation)

    def test_latents_of_another_encoder(self, materials: Tensor):
        ntm, representation = _load("rust")
        other = replace(ntm, latents=LatentLSTM(6, 5))
        with pytest.raises(ModelFileError, match="another encoder"):
            roll_out(materials[:3], other, "lstm_latents", representation)


def check(states: Tensor) -> None:
    """Finite, and within what can be rendered."""
    assert bool(torch.isfinite(states).all())
    assert float(states.min()) >= 0
    assert float(states[..., 6].min()) >= ALPHA_MIN * (1 - 1e-6)
    assert float(states[..., 6].max()) <= 1
    assert float((states[..., :3] + states[..., 3:6]).max()) <= BRIGHTEST + 1e-5


def _load(name: str):
    representation, identity = load_representation()
    ntm = NeuralTemporalModel.load(MODELS / f"{name}.safetensors", identity)
    return replace(ntm, card=replace(ntm.card, frames=10 * ntm.frames)), representation
