"""Grain and height in model files: written, read, and refused where they make no sense."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from model_runtime.backend import torch
from model_runtime.errors import ModelFileError
from model_runtime.model_files.weights import MODELS, load_model, read_card, save_model
from model_runtime.temporal.ntm import NeuralTemporalModel
from tests.grained_model import write_grained_model


@pytest.fixture(scope="module")
def grained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "grained.safetensors"
    return write_grained_model(path, bundled="char", side=64)


def load(path: Path) -> NeuralTemporalModel:
    return NeuralTemporalModel.load(path, read_card(path).representation)


def test_what_is_saved_can_be_read(grained: Path):
    ntm = load(grained)
    assert read_card(grained).version == 2
    assert ntm.grain is not None
    assert ntm.height is not None
    assert ntm.grain.tile.shape == (3, 64, 64)
    assert ntm.grain.share == 0.5
    stored, _ = load_model(grained, "ntm")
    for name, value in ntm.tensors().items():
        assert np.array_equal(value, stored[name])


def test_a_model_without_either_stays_of_version_1(tmp_path: Path):
    tensors, card = load_model(MODELS / "char.safetensors", "ntm")
    plain = {name: value for name, value in tensors.items() if not name.startswith("grain.")}
    plain.pop("height", None)
    path = tmp_path / "plain.safetensors"
    save_model(path, plain, {**card.details, "version": 2}, kind="ntm")
    assert read_card(path).version == 1
    ntm = load(path)
    assert ntm.grain is None
    assert ntm.height is None


def test_height_needs_no_grain(grained: Path, tmp_path: Path):
    tensors, card = load_model(grained, "ntm")
    kept = {name: value for name, value in tensors.items() if not name.startswith("grain.")}
    path = tmp_path / "height.safetensors"
    save_model(path, kept, card.details, kind="ntm")
    ntm = load(path)
    assert read_card(path).version == 2
    assert ntm.grain is None
    assert ntm.height is not None


def ones(*shape: int, first: float = 0.0) -> torch.Tensor:
    """1 everywhere but at age 0."""
    value = torch.ones(shape)
    value[0] = first
    return value


TENSORS: dict[str, dict[str, torch.Tensor | None]] = {
    "no tile": {"grain.tile": None},
    "no table": {"grain.table": None},
    "no shapes": {"grain.shapes": None},
    "a tile of floats": {"grain.tile": torch.zeros(3, 8, 8)},
    "a tile of integers": {"grain.tile": torch.zeros(3, 8, 8, dtype=torch.int8)},
    "a tile of one component": {"grain.tile": torch.zeros(1, 8, 8, dtype=torch.uint8)},
    "a tile of no component": {"grain.tile": torch.zeros(0, 8, 8, dtype=torch.uint8)},
    "a tile of seven components": {
        "grain.tile": torch.zeros(7, 8, 8, dtype=torch.uint8),
        "grain.table": torch.zeros(7, 256),
        "grain.shapes": torch.zeros(36, 7, 8),
    },
    "a tile that is no square": {"grain.tile": torch.zeros(3, 8, 9, dtype=torch.uint8)},
    "an empty tile": {"grain.tile": torch.zeros(3, 0, 0, dtype=torch.uint8)},
    "a flat tile": {"grain.tile": torch.zeros(3, dtype=torch.uint8)},
    "a number for a tile": {"grain.tile": torch.tensor(1, dtype=torch.uint8)},
    "a huge tile": {"grain.tile": torch.zeros(3, 1025, 1025, dtype=torch.uint8)},
    "a table of bytes": {"grain.table": torch.zeros(3, 256, dtype=torch.uint8)},
    "a short table": {"grain.table": torch.zeros(3, 255)},
    "a table that falls": {"grain.table": torch.linspace(1, 0, 256).expand(3, -1)},
    "an endless table": {"grain.table": torch.linspace(0, 9e3, 256).expand(3, -1)},
    "a table that is no number": {"grain.table": torch.full((3, 256), torch.nan)},
    "shapes of one age": {"grain.shapes": torch.zeros(1, 3, 8)},
    "shapes of no age": {"grain.shapes": torch.zeros(0, 3, 8)},
    "shapes without height": {"grain.shapes": torch.zeros(36, 3, 7)},
    "shapes that start at once": {"grain.shapes": ones(36, 3, 8, first=0.1)},
    "shapes beyond any": {"grain.shapes": 1e3 * ones(36, 3, 8)},
    "a number for height": {"height": torch.tensor(0.0)},
    "heights of one age": {"height": torch.zeros(1)},
    "heights of two places": {"height": torch.zeros(36, 2)},
    "height at once": {"height": ones(36, first=0.01)},
    "height beyond any": {"height": 2 * ones(36)},
    "height in bytes": {"height": torch.zeros(36, dtype=torch.uint8)},
    "height that is no number": {"height": ones(36) * torch.inf},
}
CARDS: dict[str, Any] = {
    "no share": {"grain": {}},
    "grain null": {"grain": None},
    "a share that is a word": {"grain": {"share": "half"}},
    "a share that is true": {"grain": {"share": True}},
    "no share at all": {"grain": {"share": 0}},
    "more than all": {"grain": {"share": 1.5}},
    "sources that are a text": {"sources": "mine"},
    "a source that is a text": {"sources": ["mine"]},
    "a source without a license": {"sources": [{"name": "mine", "credit": "me"}]},
    "a credit in bold": {"sources": [{"name": "m", "license": "CC0", "credit": "\x1b[1mme"}]},
}


def refused(path: Path) -> None:
    with pytest.raises(ModelFileError) as error:
        load(path)
    assert path.name in error.value.message
    assert str(error.value).isprintable()


@pytest.mark.parametrize("change", TENSORS.values(), ids=TENSORS.keys())
def test_tensors_that_make_no_sense(
    grained: Path, tmp_path: Path, change: dict[str, torch.Tensor | None]
):
    tensors, card = load_model(grained, "ntm")
    changed = {name: value for name, value in (tensors | change).items() if value is not None}
    path = tmp_path / "grained.safetensors"
    save_model(path, changed, card.details, kind="ntm")
    refused(path)


@pytest.mark.parametrize("change", CARDS.values(), ids=CARDS.keys())
def test_cards_that_make_no_sense(grained: Path, tmp_path: Path, change: dict[str, Any]):
    tensors, card = load_model(grained, "ntm")
    path = tmp_path / "grained.safetensors"
    save_model(path, tensors, {**card.details, **change}, kind="ntm")
    refused(path)


def test_only_the_tile_may_be_of_bytes(tmp_path: Path, grained: Path):
    tensors, card = load_model(grained, "ntm")
    path = tmp_path / "grained.safetensors"
    bytes_ = torch.zeros_like(tensors["affine.gain"], dtype=torch.uint8)
    save_model(path, tensors | {"affine.gain": bytes_}, card.details, kind="ntm")
    refused(path)


def test_the_made_up_grain_keeps_its_promise(grained: Path):
    grain = load(grained).grain
    assert grain is not None
    gaussian = (grain.tile / 255 * 2 - 1) * 4
    assert np.abs(gaussian.mean((1, 2))).max() < 0.05
    assert np.abs(gaussian.std((1, 2)) - 1).max() < 0.05
