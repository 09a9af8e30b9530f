"""A checkpoint brings everything back, or says in a sentence why it cannot."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from model_runtime.errors import ModelFileError, OutputError, UsageError
from model_runtime.model_files.weights import ENCODER
from training.checkpoint import DivergedError, load_checkpoint, save_checkpoint

RUN = {"seed": 0}
FRESH = {"step": 0, "iterations": 9, "seconds": 0.0, "run": RUN}


def parts():
    torch.manual_seed(0)
    model = torch.nn.Linear(3, 2)
    return model, torch.optim.Adam(model.parameters()), torch.Generator().manual_seed(1)


def test_everything_comes_back(tmp_path):
    model, optimizer, g = parts()
    for _ in range(3):
        optimizer.zero_grad()
        model(torch.rand(4, 3, generator=g)).square().sum().backward()
        optimizer.step()
    path = tmp_path / "new" / "c.safetensors"
    save_checkpoint(path, model=model, optimizer=optimizer, generator=g, record=FRESH | {"step": 3})
    expected = torch.rand(2, generator=g)
    other, adam, h = parts()
    record = load_checkpoint(path, model=other, optimizer=adam, generator=h, fresh=FRESH)
    assert record == FRESH | {"step": 3}
    assert torch.equal(other.weight, model.weight)
    one, two = (o.state_dict()["state"][0] for o in (optimizer, adam))
    assert all(torch.equal(one[key], two[key]) for key in ("exp_avg", "exp_avg_sq", "step"))
    assert torch.equal(torch.rand(2, generator=h), expected)
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_before_the_first_step(tmp_path):
    model, optimizer, g = parts()
    path = tmp_path / "c.safetensors"
    save_checkpoint(path, model=model, optimizer=optimizer, generator=g, record=FRESH)
    record = load_checkpoint(path, model=model, optimizer=optimizer, generator=g, fresh=FRESH)
    assert record == FRESH


@pytest.mark.parametrize("damage", ["missing", "cut", "other shapes", "a model file"])
def test_damage_is_a_sentence(tmp_path, damage: str):
    model, optimizer, g = parts()
    path = tmp_path / "c.safetensors"
    save_checkpoint(path, model=model, optimizer=optimizer, generator=g, record=FRESH)
    if damage == "missing":
        path.unlink()
    elif damage == "cut":
        path.write_bytes(path.read_bytes()[:-5])
    elif damage == "other shapes":
        model = torch.nn.Linear(3, 5)
    else:
        path.write_bytes(ENCODER.read_bytes())
    with pytest.raises(ModelFileError, match=r"c\.safetensors") as error:
        load_checkpoint(path, model=model, optimizer=optimizer, generator=g, fresh=FRESH)
    assert "--resume" in error.value.hint


@pytest.fixture
def stored(tmp_path):
    """A checkpoint after a step, and what it was made of."""
    model, optimizer, g = parts()
    model(torch.rand(4, 3)).square().sum().backward()
    optimizer.step()
    path = tmp_path / "c.safetensors"
    save_checkpoint(path, model=model, optimizer=optimizer, generator=g, record=FRESH | {"step": 1})
    return path, {"model": model, "optimizer": optimizer, "generator": g}


def changed(path: Path, tensors: dict[str, torch.Tensor | None], **record) -> None:
    """Write the checkpoint at `path` again, with some tensors and fields of its record replaced."""
    content = {k: v for k, v in {**load_file(path), **tensors}.items() if v is not None}
    said = {k: v for k, v in {**FRESH, "step": 1, **record}.items() if v is not ...}
    save_file(content, path, {"record": json.dumps(said)})


@pytest.mark.parametrize("name", ["model.weight", "adam.0.exp_avg", "adam.1.exp_avg_sq"])
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_and_moments_that_are_no_numbers(stored, name: str, value: float):
    path, made = stored
    before = made["model"].weight.clone()
    changed(path, {name: torch.full_like(load_file(path)[name], value)})
    with pytest.raises(ModelFileError, match=f"not finite .{name}") as error:
        load_checkpoint(path, fresh=FRESH, **made)
    assert "--resume" in error.value.hint
    assert torch.equal(made["model"].weight, before)


@pytest.mark.parametrize(
    "tensors",
    [
        {"adam.0.exp_avg": torch.zeros(7)},
        {"adam.0.exp_avg": None},
        {"model.bias": None},
        {"generator": None},
        {"generator": torch.zeros(4, dtype=torch.uint8)},
        {"generator": torch.zeros(4)},
    ],
    ids=str,
)
def test_parts_that_do_not_fit(stored, tensors):
    path, made = stored
    changed(path, tensors)
    with pytest.raises(ModelFileError, match="another model"):
        load_checkpoint(path, fresh=FRESH, **made)


@pytest.mark.parametrize(
    "record",
    [
        {"step": -1},
        {"step": 10},
        {"step": "1"},
        {"step": True},
        {"step": ...},
        {"iterations": 10**30},
        {"seconds": float("nan")},
        {"seconds": -1.0},
        {"surprise": 1},
    ],
    ids=str,
)
def test_a_record_that_no_training_wrote(stored, record):
    path, made = stored
    changed(path, {}, **record)
    with pytest.raises(ModelFileError, match="no usable record"):
        load_checkpoint(path, fresh=FRESH, **made)


def test_another_run_s_is_a_matter_of_usage(stored):
    path, made = stored
    with pytest.raises(UsageError, match="other settings"):
        load_checkpoint(path, fresh=FRESH | {"run": {"seed": 1}}, **made)


def test_what_is_no_file_is_not_waited_for(tmp_path):
    model, optimizer, g = parts()
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe"):
        with pytest.raises(ModelFileError, match="cannot be read"):
            load_checkpoint(path, model=model, optimizer=optimizer, generator=g, fresh=FRESH)


def test_a_training_that_has_diverged_leaves_its_last_checkpoint(stored):
    path, made = stored
    before = path.read_bytes()
    with torch.no_grad():
        made["model"].weight[0, 0] = float("nan")
    with pytest.raises(DivergedError, match="not finite"):
        save_checkpoint(path, record=FRESH, **made)
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device here")
def test_so_does_a_full_disk(stored, monkeypatch):
    path, made = stored
    before = path.read_bytes()

    def write(self: Path, content: bytes) -> None:
        self.touch()
        with Path("/dev/full").open("wb") as full:
            full.write(content)

    monkeypatch.setattr(Path, "write_bytes", write)
    with pytest.raises(OutputError, match="No space left"):
        save_checkpoint(path, record=FRESH, **made)
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]
