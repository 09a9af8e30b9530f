"""Grain is given to a model whose networks stay: so the bundled models of formulas got theirs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from torch import Tensor

from model_runtime.errors import InputError
from model_runtime.model_files.weights import find_model, read_card
from training.data import weathering
from training.data.sequences import Sequence, uniform_times
from training.data.writing import write_sequence
from training.grain import give_grain
from training.source.onsets import timed

OF_FORMULAS = ("char", "drying", "fading", "patina", "yellowing")


def alike(first: dict[str, Tensor], second: dict[str, Tensor]) -> bool:
    return first.keys() == second.keys() and all(
        torch.equal(value, second[name]) for name, value in first.items()
    )


def parts(file: Path, *, grain: bool) -> dict[str, Tensor]:
    """What a file holds of grain and relief, or all else."""
    return {
        name: value
        for name, value in load_file(file).items()
        if (name.startswith("grain.") or name == "height") == grain
    }


@pytest.mark.parametrize("name", OF_FORMULAS)
def test_a_bundled_model_s_grain_is_that_of_its_card_s_commands(name: str, tmp_path: Path):
    bundled = find_model(name)
    card = read_card(bundled)
    assert f"python -m training weathering {name} --size 160 --seed 0" in card.source
    assert card.trained["grain"] == (
        f"python -m training grain --sequence {name} --model {name}.safetensors "
        f"--output {name}.safetensors --seed 0"
    )
    weathering.write(name, tmp_path / name, size=160)
    made = give_grain(sequence=tmp_path / name, model=bundled, output=tmp_path / "made")
    assert parts(bundled, grain=True)
    assert alike(load_file(made), load_file(bundled))


def test_all_else_stays_as_it_is(tmp_path: Path):
    weathering.write("moss", tmp_path / "moss", size=64)
    bundled = find_model("char")
    made = give_grain(sequence=tmp_path / "moss", model=bundled, output=tmp_path / "made")
    assert alike(parts(made, grain=False), parts(bundled, grain=False))
    assert not alike(parts(made, grain=True), parts(bundled, grain=True))
    before, after = (dict(read_card(file).details) for file in (bundled, made))
    assert after.pop("trained")["grain"] != before.pop("trained")["grain"]
    assert after == before


def test_a_sequence_without_any_gives_none(tmp_path: Path):
    kd = np.linspace(0.1, 0.5, 6, dtype=np.float32)[:, None, None, None] * np.ones(
        (1, 8, 8, 3), "f"
    )
    plain = timed(Sequence(kd, kd, kd[..., 0], uniform_times(6), np.zeros((8, 8), "f"), "plain"))
    assert isinstance(plain, Sequence)
    write_sequence(plain, tmp_path / "plain", {})
    with pytest.raises(InputError, match="neither grain nor height"):
        give_grain(sequence=tmp_path / "plain", model=find_model("char"), output=tmp_path / "made")
    assert not (tmp_path / "made").exists()
