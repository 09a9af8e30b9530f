"""The bundled models of change, run ten times longer than trained, from anything at all."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from model_runtime.brdf.torrance_sparrow import ALPHA_MIN
from model_runtime.fit import fit_angles, fit_torrance_sparrow
from model_runtime.package import MODELS, list_models
from model_runtime.plan import clamp_parameters, viewing_angles
from model_runtime.representation import load_representation
from model_runtime.representation.latents import Latents
from model_runtime.temporal.models import ParameterLSTM
from model_runtime.temporal.ntm import NeuralTemporalModel

COUNT = 10_000
LIMIT = ParameterLSTM.LIMIT + 1e-3
FITTED = 300
BRIGHTEST = 2.5
"""Albedo that no rollout exceeds: inputs have at most 1, and what is brighter cannot be shown."""


@pytest.fixture(scope="module")
def materials() -> Tensor:
    """States [10000, 7] of every colour, gloss and metalness; Kd + Ks at most 1."""
    g = torch.Generator().manual_seed(0)
    states = torch.rand(COUNT, 7, generator=g)
    albedo = (states[:, :3] + states[:, 3:6]).amax(1, keepdim=True).clamp_min(1)
    return torch.cat((states[:, :6] / albedo, 10 ** (-4 * states[:, 6:])), 1)


def albedo(states: Tensor) -> float:
    """The largest Kd + Ks."""
    return float((states[..., :3] + states[..., 3:6]).max())


@pytest.mark.parametrize("name", [card.name for card in list_models((MODELS,))])
class TestTenTimesLonger:
    @torch.inference_mode()
    def test_on_parameters(self, name: str, materials: Tensor):
        ntm, _ = _load(name)
        states = clamp_parameters(ntm.parameters.rollout(materials, 10 * ntm.frames))
        assert bool(torch.isfinite(states).all())
        assert float(states[..., 6].min()) >= ALPHA_MIN
        assert float(states[..., 6].max()) <= 1
        assert albedo(states) < BRIGHTEST

    @torch.inference_mode()
    def test_on_latents(self, name: str, materials: Tensor):
        ntm, representation = _load(name)
        color, _ = representation.latent_sizes
        first = representation.encode_parameters(materials)
        last = ntm.latents.rollout(first.flat(), 10 * ntm.frames)[:, -1]
        assert bool((((last - ntm.latents.mean) / ntm.latents.scale).abs() <= LIMIT).all())
        latents = Latents(last[:, :color].reshape(COUNT, 3, -1), last[:, color:])
        f = representation.decode(latents, viewing_angles())
        assert bool(torch.isfinite(f).all())
        few = Latents(latents.color[:FITTED], latents.shared[:FITTED])
        fit = fit_torrance_sparrow(representation.decode(few, fit_angles()))
        assert albedo(fit.parameters()) < BRIGHTEST


def _load(name: str):
    representation, identity = load_representation()
    return NeuralTemporalModel.load(MODELS / f"{name}.safetensors", identity), representation
