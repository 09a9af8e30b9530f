"""A checkpoint brings everything back, or says in a sentence why it cannot."""

from __future__ import annotations

import pytest
import torch

from model_runtime.errors import ModelFileError
from model_runtime.package import ENCODER
from training.checkpoint import load_checkpoint, save_checkpoint

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
