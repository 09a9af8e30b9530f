"""Training an encoder: one that was killed ends as one that was not, and leaves a usable file."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from safetensors import safe_open

from model_runtime.errors import ModelFileError, UsageError
from model_runtime.model_files.weights import read_card
from model_runtime.representation import load_representation
from tests.trainings import equal, kill_at, small
from training.encoder import CONFIGS, train_encoder

pytestmark = pytest.mark.usefixtures("one_thread")

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize("name", ["fast", "paper"])
def test_killed_and_resumed_it_ends_as_it_would_have(data_folder, tmp_path, monkeypatch, name):
    monkeypatch.setitem(CONFIGS, name, small(name))
    whole, parts = tmp_path / "whole.safetensors", tmp_path / "parts.safetensors"
    train_encoder(config=name, output=whole, seed=3)
    for at in (2, 2):  # killed twice: a checkpoint further each time
        kill_at(at, lambda: train_encoder(config=name, output=parts, seed=3, resume=True))
        assert not parts.exists()
    torch.rand(5)  # whatever random numbers are drawn meanwhile
    train_encoder(config=name, output=parts, seed=3, resume=True)
    assert equal(whole, parts)
    assert not list(tmp_path.glob("*checkpoint*"))


def test_so_does_one_that_was_killed_while_it_learned_the_short_cut(
    data_folder, tmp_path, monkeypatch
):
    monkeypatch.setitem(CONFIGS, "fast", small("fast", distillation=8))
    whole, parts = tmp_path / "whole.safetensors", tmp_path / "parts.safetensors"
    train_encoder(config="fast", output=whole, seed=3)
    kill_at(7, lambda: train_encoder(config="fast", output=parts, seed=3))  # of five and three
    assert (tmp_path / "parts.short_cut.checkpoint.safetensors").exists()
    train_encoder(config="fast", output=parts, seed=3, resume=True)
    assert equal(whole, parts)
    assert not list(tmp_path.glob("*checkpoint*"))


def test_the_file_is_an_encoder_with_a_card(data_folder, tmp_path, monkeypatch):
    monkeypatch.setitem(CONFIGS, "fast", small("fast", iterations=2))
    path = train_encoder(config="fast", output=tmp_path / "new" / "e.safetensors", seed=7)
    model, identity = load_representation(path)
    assert model.name == "lobes"
    assert len(identity) == 16
    card = read_card(path)
    assert card.kind == "encoder"
    assert card.trained["seed"] == 7
    assert card.trained["iterations"] == 2
    assert card.trained["config"]["batch"] == 8
    assert {"alum-bronze", "steel"} <= set(card.trained["held_out"])
    assert "MERL" in card.source


def test_seeds_matter_and_repeat(data_folder, tmp_path, monkeypatch):
    monkeypatch.setitem(CONFIGS, "fast", small("fast", iterations=2))
    one, same, other = (
        train_encoder(config="fast", output=tmp_path / f"{k}.safetensors", seed=seed)
        for k, seed in enumerate((1, 1, 2))
    )
    assert equal(one, same)
    assert not equal(one, other)


def test_minutes_set_the_number_of_iterations(data_folder, tmp_path, monkeypatch):
    monkeypatch.setitem(CONFIGS, "fast", small("fast", iterations=10**6))
    path = train_encoder(config="fast", output=tmp_path / "e.safetensors", minutes=1e-3)
    assert 1 <= read_card(path).trained["iterations"] < 10_000


def test_without_resume_it_starts_again(data_folder, tmp_path, monkeypatch):
    monkeypatch.setitem(CONFIGS, "fast", small("fast", iterations=2))
    path = train_encoder(config="fast", output=tmp_path / "e.safetensors", seed=1)
    train_encoder(config="fast", output=path, seed=2)
    fresh = train_encoder(config="fast", output=tmp_path / "f.safetensors", seed=2)
    assert equal(path, fresh)


def test_a_damaged_checkpoint_is_a_sentence(data_folder, tmp_path, monkeypatch):
    monkeypatch.setitem(CONFIGS, "fast", small("fast", iterations=2))
    (tmp_path / "e.checkpoint.safetensors").write_bytes(b"rubbish")
    with pytest.raises(ModelFileError, match="cannot be read") as error:
        train_encoder(config="fast", output=tmp_path / "e.safetensors", resume=True)
    assert "without --resume" in error.value.hint


def test_so_is_another_recipe_s(data_folder, tmp_path, monkeypatch):
    for name in ("fast", "paper"):
        monkeypatch.setitem(CONFIGS, name, small(name))
    kill_at(2, lambda: train_encoder(config="paper", output=tmp_path / "e.safetensors"))
    with pytest.raises(UsageError, match="other settings"):
        train_encoder(config="fast", output=tmp_path / "e.safetensors", resume=True)


def test_so_is_another_seed_s(data_folder, tmp_path, monkeypatch):
    monkeypatch.setitem(CONFIGS, "fast", small("fast"))
    kill_at(2, lambda: train_encoder(config="fast", output=tmp_path / "e.safetensors", seed=1))
    with pytest.raises(UsageError, match="other settings"):
        train_encoder(config="fast", output=tmp_path / "e.safetensors", resume=True, seed=2)


@pytest.mark.slow
def test_killed_by_the_system(data_folder, tmp_path, monkeypatch):
    """kill -9 at whatever moment: the checkpoint is whole and the end is the same."""
    recipe = small("fast", iterations=60)
    monkeypatch.setitem(CONFIGS, "fast", recipe)
    code = (
        "import sys, torch\n"
        "from pathlib import Path\n"
        "from dataclasses import replace\n"
        "from tests.trainings import fast_clock, small\n"
        "from training import encoder, loop\n"
        "torch.set_num_threads(1)\n"
        "loop.time = fast_clock(61)\n"
        "encoder.CONFIGS['fast'] = small('fast', iterations=60)\n"
        "encoder.train_encoder(config='fast', output=Path(sys.argv[1]), seed=5)\n"
    )
    output = tmp_path / "killed.safetensors"
    checkpoint = tmp_path / "killed.checkpoint.safetensors"
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(output)], cwd=ROOT, stderr=subprocess.DEVNULL
    )
    try:
        deadline = time.monotonic() + 120
        while not checkpoint.exists() and time.monotonic() < deadline:
            time.sleep(0.02)
        time.sleep(0.3)
    finally:
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
    with safe_open(checkpoint, framework="pt") as stored:
        step = json.loads(stored.metadata()["record"])["step"]
    assert step >= 1
    train_encoder(config="fast", output=output, seed=5, resume=True)
    whole = train_encoder(config="fast", output=tmp_path / "whole.safetensors", seed=5)
    assert equal(whole, output)
