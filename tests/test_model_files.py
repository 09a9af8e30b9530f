"""Model files and their cards: saved whole, read without torch, found by name."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from model_runtime.backend import torch
from model_runtime.errors import ModelFileError, OutputError
from model_runtime.model_files.weights import (
    MODELS,
    find_model,
    hash_tensors,
    list_models,
    load_model,
    read_card,
    save_model,
)
from tests.model_bytes import CARD, model_bytes, stored

ROOT = Path(__file__).resolve().parents[1]


def test_a_card_says_what_the_file_says(tmp_path: Path):
    path = stored(tmp_path, model_bytes())
    card = read_card(path)
    assert (card.path, card.kind, card.version, card.frames) == (path, "ntm", 1, 36)
    texts = ("name", "title", "description", "process", "representation", "source", "license")
    for name in (*texts, "domain", "trained"):
        assert getattr(card, name) == CARD[name]
    assert card.details == CARD


def test_what_is_saved_can_be_read(tmp_path: Path):
    path = tmp_path / "new" / "moss.safetensors"
    tensors = {"a": torch.arange(6.0).reshape(2, 3), "b": torch.ones(4).expand(2, 4)}
    save_model(path, tensors, CARD | {"title": "Möß"}, kind="ntm")
    loaded, card = load_model(path, "ntm")
    assert (card.name, card.title, card.version) == ("moss", "Möß", 1)
    assert {name: value.tolist() for name, value in loaded.items()} == {
        name: value.tolist() for name, value in tensors.items()
    }
    assert [p.name for p in path.parent.iterdir()] == [path.name]  # nothing is left beside


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.safetensors")), ids=lambda path: path.stem)
def test_bundled_models_can_be_loaded_and_carry_the_contract_s_fields(path: Path):
    kind = read_card(path).kind
    _, card = load_model(path, kind)
    assert card.details["format"] == f"tvbrdf-{kind}"
    if kind == "ntm":
        contract = "format version name title description process frames representation domain"
        for name in (*contract.split(), "source", "license", "trained"):
            assert name in card.details, name
        assert card.frames >= 2
        assert card.name == path.stem


BLOCKED = ("torch", "numpy", "safetensors", "OpenEXR", "PIL")
WITHOUT_LIBRARIES = f"""
import sys
for name in {BLOCKED!r}: sys.modules[name] = None
from pathlib import Path
from model_runtime.model_files.weights import find_model, list_models, read_card
for card in list_models((Path(sys.argv[1]),)):
    print(card.name, card.title, card.frames, card.domain["ranges"])
print(find_model("moss", (Path(sys.argv[1]),)).name)
"""


def test_cards_need_the_standard_library_alone(tmp_path: Path):
    stored(tmp_path, model_bytes())
    stored(tmp_path, b"rubbish", "rubbish.safetensors")
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_LIBRARIES, str(tmp_path)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[:2] == ["moss Moss 36 {'alpha': [0.1, 0.4]}", "moss.safetensors"]


class TestListing:
    def test_by_title_from_all_folders_without_what_is_broken(self, tmp_path: Path):
        (tmp_path / "a").mkdir()
        (tmp_path / "b").mkdir()
        for folder, name, title in (
            ("a", "one", "Zinc"),
            ("b", "two", "Algae"),
            ("a", "x", "Moss"),
        ):
            card = CARD | {"name": name, "title": title}
            stored(tmp_path / folder, model_bytes(card), f"{name}.safetensors")
        stored(tmp_path / "a", b"rubbish", "rubbish.safetensors")
        stored(tmp_path / "a", model_bytes(), "moss.txt")
        found = list_models((tmp_path / "a", tmp_path / "b", tmp_path / "none"))
        assert [card.title for card in found] == ["Algae", "Moss", "Zinc"]

    def test_it_says_what_is_skipped(self, tmp_path: Path):
        stored(tmp_path, model_bytes())
        stored(tmp_path, model_bytes(CARD | {"title": "\ud800"}), "broken.safetensors")
        stored(tmp_path, model_bytes(CARD | {"format": "tvbrdf-encoder"}), "encoder.safetensors")
        said: list[ModelFileError] = []
        folders = (tmp_path, tmp_path / "none", tmp_path / "moss.safetensors")
        assert [card.name for card in list_models(folders, skipped=said.append)] == ["moss"]
        assert "broken.safetensors" in said[0].message
        assert "cannot be read" in said[1].message
        assert len(said) == 2

    def test_of_one_name_the_last_folder_s_is_listed_and_whose_it_is_is_said(self, tmp_path: Path):
        for folder in ("bundled", "a user's"):
            (tmp_path / folder).mkdir()
            stored(tmp_path / folder, model_bytes(CARD), f"{folder}.safetensors")
        folders = (tmp_path / "bundled", tmp_path / "a user's")
        (card,) = list_models(folders)
        assert card.path.parent.name == "a user's"
        assert card.summary == "Grows (yours, not the bundled model of this name)"
        assert find_model("moss", folders) == card.path
        (bundled,) = list_models(folders[:1])
        assert bundled.summary == "Grows"

    def test_a_second_one_of_a_name_in_a_folder_is_said(self, tmp_path: Path):
        for name in ("a", "b"):
            stored(tmp_path, model_bytes(CARD), f"{name}.safetensors")
        said: list[ModelFileError] = []
        (card,) = list_models((tmp_path, tmp_path), skipped=said.append)
        assert card.path.name == "a.safetensors"
        assert [error.message for error in said] == [
            "b.safetensors calls itself moss, as a.safetensors does."
        ]

    def test_a_model_is_found_by_its_name(self, tmp_path: Path):
        path = stored(tmp_path, model_bytes(), "any file name.safetensors")
        assert find_model("moss", (tmp_path,)) == path

    def test_or_by_its_path_which_need_not_be_listed(self, tmp_path: Path):
        path = tmp_path / "elsewhere.safetensors"
        assert find_model(str(path), ()) == path

    def test_an_unknown_name_is_told_the_known_ones(self, tmp_path: Path):
        stored(tmp_path, model_bytes())
        with pytest.raises(ModelFileError, match=r"called 'mos'.*moss"):
            find_model("mos", (tmp_path,))
        with pytest.raises(ModelFileError, match="none"):
            find_model("moss", ())

    def test_rust_is_bundled(self):
        assert find_model("rust").parent == MODELS
        assert "rust" in [card.name for card in list_models()]


class TestHash:
    def test_it_knows_names_shapes_types_and_values(self):
        plain = {"a": torch.arange(4.0), "b": torch.zeros(2)}
        others = [
            {"a": torch.arange(4.0), "c": torch.zeros(2)},
            {"a": torch.arange(4.0).reshape(2, 2), "b": torch.zeros(2)},
            {"a": torch.arange(4.0).double(), "b": torch.zeros(2)},
            {"a": torch.tensor((0, 1, 2, 3.0000005)), "b": torch.zeros(2)},
            {"a": torch.arange(4.0)},
        ]
        hashes = {hash_tensors(tensors) for tensors in (plain, *others)}
        assert len(hashes) == 1 + len(others)

    def test_it_knows_neither_order_nor_layout(self):
        a = torch.arange(6.0).reshape(2, 3)
        one = {"a": a, "b": torch.zeros(2)}
        other = {"b": torch.zeros(2), "a": a.T.contiguous().T}
        assert hash_tensors(one) == hash_tensors(other)
        assert len(hash_tensors(one)) == 16


def test_saving_that_fails_leaves_the_earlier_file(tmp_path: Path, monkeypatch):
    path = tmp_path / "moss.safetensors"
    save_model(path, {"w": torch.zeros(1)}, {"name": "moss"}, kind="ntm")
    before = path.read_bytes()
    monkeypatch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(OSError("full")))
    with pytest.raises(OutputError, match="full"):
        save_model(path, {"w": torch.ones(1)}, {"name": "moss"}, kind="ntm")
    assert path.read_bytes() == before


def test_a_file_that_does_not_pass_its_check_replaces_nothing(tmp_path: Path):
    path = tmp_path / "moss.safetensors"
    save_model(path, {"w": torch.zeros(1)}, CARD, kind="ntm")
    before = path.read_bytes()
    broken = {"w": torch.tensor([float("nan")])}
    with pytest.raises(
        ModelFileError, match=r"^moss\.safetensors was not written: it .*not finite"
    ):
        save_model(path, broken, CARD, kind="ntm", check=lambda file: load_model(file, "ntm"))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_they_are_read_without_torch_being_loaded():
    code = "import sys, model_runtime.model_files.weights\nprint('torch' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert done.stdout.strip() == "False"
