"""Aging on another device than the CPU, as far as that can be seen without one.

"meta" is a device that keeps shapes and no values: it refuses, as a GPU does, to mix its tensors
with the CPU's.
"""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from model_runtime.device import CPU
from model_runtime.errors import UsageError
from model_runtime.model_files.weights import find_model
from model_runtime.modelling import rollout
from model_runtime.modelling.aged import EFFORTS, Change, model_texels
from model_runtime.representation import load_representation
from model_runtime.representation.estimator import ParameterEstimator
from model_runtime.representation.latents import Representation
from model_runtime.temporal.ntm import NeuralTemporalModel
from tests.aging import run

META = torch.device("meta")
STATES = torch.rand(9, 7, generator=torch.Generator().manual_seed(0)).clamp_min(0.01)

Models = tuple[NeuralTemporalModel, Representation]


@pytest.fixture(scope="module")
def models() -> Models:
    representation, identity = load_representation()
    return NeuralTemporalModel.load(find_model("rust"), identity), representation


@pytest.mark.parametrize("fitted", [True, False])
def test_all_that_a_device_is_asked_for_stays_on_it(models: Models, fitted: bool):
    """What fails in the end is to bring back the values, which "meta" does not have."""
    ntm, representation = models
    estimator = None if fitted else ParameterEstimator()
    with torch.inference_mode(), pytest.raises(NotImplementedError, match="meta tensor; no data"):
        rollout.roll_out(
            STATES, ntm, "lstm_latents", representation, estimator=estimator, device=META
        )


@pytest.mark.parametrize("rung", ["affine", "lstm_parameters"])
def test_what_is_light_stays_on_the_cpu(models: Models, rung: str):
    ntm, representation = models
    there, here = (
        rollout.roll_out(STATES, ntm, rung, representation, device=device).states
        for device in (META, CPU)
    )
    assert torch.equal(there, here)


def test_the_device_that_is_recorded_is_the_one_that_was_used(models: Models):
    """Not what was asked for: this rung leaves the CPU for nothing."""
    ntm, representation = models
    assert rollout.roll_out(STATES, ntm, "affine", representation, device=META).device == "cpu"


@pytest.mark.parametrize("device", ["cuda", "cuda:0", "cuda:1"])
def test_a_device_that_is_not_there_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, device: str
):
    """Said before anything is read, and not an error of torch's minutes later."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: device == "cuda:1")
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    with pytest.raises(UsageError, match=f"There is no device {device} ") as error:
        run(tmp_path / "none", tmp_path / "aged", device=device)
    assert "--device auto" in error.value.hint


def test_where_a_device_fails_the_cpu_does_it_and_it_is_said(models: Models):
    ntm, representation = models
    said: list[str] = []
    with torch.inference_mode():
        there, here = (
            model_texels(
                STATES,
                Change(ntm, "lstm_latents", representation, device=device, warn=said.append),
                EFFORTS["draft"],
            ).histories.states
            for device in (META, CPU)
        )
    assert torch.equal(there, here)
    assert len(said) == 1
    assert said[0].startswith("The GPU failed (")
    assert said[0].endswith("), so the CPU was used.")
