"""The rival that starts from noise: it learns, resumes, and plays any size at any time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open

from model_runtime.errors import UsageError
from training.baselines.ode import Config, Flow, play, train_flow
from training.loop import Run
from training.metric.texture import TextureMetric

pytestmark = pytest.mark.usefixtures("one_thread")

TIMES = np.linspace(0, 1, 4, dtype=np.float32)


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    """Even gray that turns to even green, with noise."""
    rng = np.random.default_rng(0)
    colors = np.array((0.6, 0.6, 0.6)) + np.linspace(0, 1, 5)[:, None] * np.array((-0.5, 0, -0.4))
    noise = 0.15 * rng.standard_normal((5, 32, 32, 3))
    return (colors[:, None, None] + noise).clip(0, 1).astype(np.float32)


def learned(frames: np.ndarray, data: Path, run: Run, steps: int) -> Flow:
    metric = TextureMetric.load(data / "perceptual")
    config = Config(side=16, iterations=steps, rate=1e-3, warm_up=4)
    return train_flow(frames, metric, run, config, {"command": "test"})


def test_it_takes_the_colors_of_the_film_and_leaves_its_record(
    frames: np.ndarray, data_folder: Path, tmp_path: Path
):
    path = tmp_path / "ode.safetensors"
    played = play(learned(frames, data_folder, Run(path), 48), (32, 48), TIMES)
    assert played.shape == (4, 32, 48, 3)
    unlearned = play(Flow(), (32, 48), TIMES)
    for k, truth in ((0, frames[0]), (-1, frames[-1])):
        far, before = (
            np.abs(each[k].mean((0, 1)) - truth.mean((0, 1))).max() for each in (played, unlearned)
        )
        assert far < before
    with safe_open(path, "np") as stored:
        assert '"command": "test"' in stored.metadata()["record"]
    assert path.stat().st_size < 1e6
    assert not path.with_suffix(".checkpoint.safetensors").exists()


def test_what_was_interrupted_ends_as_if_it_had_not(
    frames: np.ndarray, data_folder: Path, tmp_path: Path
):
    def killed(_: str, share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    whole = learned(frames, data_folder, Run(tmp_path / "whole.safetensors"), 8)
    run = Run(tmp_path / "part.safetensors", save_every=0.0, watch=killed)
    with pytest.raises(KeyboardInterrupt):
        learned(frames, data_folder, run, 8)
    again = learned(frames, data_folder, replace(run, resume=True, watch=None), 8)
    for one, other in zip(whole.parameters(), again.parameters(), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=0)


def test_any_size_that_can_be_halved_twice(tmp_path: Path):
    first = play(Flow(), (20, 12), TIMES, seed=1)
    assert first.shape == (4, 20, 12, 3)
    np.testing.assert_array_equal(play(Flow(), (20, 12), TIMES, seed=1), first)
    with pytest.raises(UsageError, match="multiple of 4"):
        play(Flow(), (30, 30), TIMES)
