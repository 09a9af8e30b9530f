"""The list of models in Blender, whatever lies in the user's folder."""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path

import bpy
import pytest

from model_runtime.model_files import weights
from tvbrdf.tvbrdf_addon import finding, models, pictures, preferences, properties

BUNDLED = {path.stem for path in weights.MODELS.glob("*.safetensors") if "encoder" not in path.stem}
RUST = weights.MODELS / "rust.safetensors"


@pytest.fixture
def folder(empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's folder of models, chosen in the preferences."""
    monkeypatch.setattr(preferences, "model_folders", lambda: (weights.MODELS, tmp_path))
    return tmp_path


def write(path: Path, **changes: object) -> None:
    """Rust under another name, its card changed."""
    content = RUST.read_bytes()
    length = struct.unpack("<Q", content[:8])[0]
    header = json.loads(content[8 : 8 + length])
    card = json.loads(header["__metadata__"]["card"]) | {"name": "mine", "title": "Mine"} | changes
    header["__metadata__"]["card"] = json.dumps(card)
    changed = json.dumps(header).encode()
    changed += b" " * (-len(changed) % 8)
    path.write_bytes(struct.pack("<Q", len(changed)) + changed + content[8 + length :])


def names() -> set[str]:
    """As Blender lists them: an assignment looks at every item."""
    settings = bpy.data.materials.new("any").tvbrdf
    settings.ntm = "rust"
    assert settings.ntm == "rust"
    items = properties._model_items(settings, bpy.context)
    for name, *_ in items:
        settings.ntm = name
        assert settings.ntm == name
    return {item[0] for item in items}


def left_out() -> tuple[str, ...]:
    return models.models_in(preferences.model_folders()).left_out


def test_a_model_of_ones_own_is_listed(folder: Path):
    write(folder / "mine.safetensors")
    assert names() == BUNDLED | {"mine", "file"}
    assert left_out() == ()


@pytest.mark.parametrize(
    "changes",
    [
        {"title": "half \udce9"},
        {"name": "half\udce9"},
        {"description": "\ud800"},
        {"title": "\x1b[2J"},
        {"title": "a\0b"},
        {"title": "x" * 1_000_000},
        {"description": "x" * 1_000_000},
        {"title": ""},
        {"name": ""},
        {"name": None},
        {"title": ["Mine"]},
        {"name": "file"},
    ],
    ids=lambda changes: ascii(changes)[:24],
)
def test_one_bad_model_is_left_out_and_said_and_the_others_stay(folder: Path, changes: dict):
    write(folder / "bad.safetensors", **changes)
    write(folder / "good.safetensors", name="good", title="Good")
    assert names() == BUNDLED | {"good", "file"}
    (sentence,) = left_out()
    assert "bad.safetensors" in sentence
    assert len(sentence) < 1000 and sentence.isprintable()


def test_what_is_no_file_is_left_out_and_never_waited_for(folder: Path):
    os.mkfifo(folder / "fifo.safetensors")
    (folder / "device.safetensors").symlink_to("/dev/zero")
    (folder / "folder.safetensors").mkdir()
    with (folder / "gigantic.safetensors").open("wb") as file:
        file.truncate(1 << 40)
    assert names() == BUNDLED | {"file"}
    assert len(left_out()) == 4


@pytest.mark.parametrize("place", ["nowhere", "x" * 300, "file"])
def test_a_folder_that_is_none_leaves_the_bundled_models(folder: Path, monkeypatch, place: str):
    (folder / "file").write_text("")
    monkeypatch.setattr(preferences, "model_folders", lambda: (weights.MODELS, folder / place))
    assert names() == BUNDLED | {"file"}


def test_one_named_as_a_bundled_one_takes_its_place_and_says_so(folder: Path):
    write(folder / "mine.safetensors", name="rust", title="My Rust", description="Mine.")
    assert names() == BUNDLED | {"file"}
    (item,) = (each for each in properties._model_items(None, bpy.context) if each[0] == "rust")
    assert item[1:3] == ("My Rust", "Mine. (yours, not the bundled model of this name)")
    settings = bpy.data.materials.new("any").tvbrdf
    settings.ntm = "rust"
    assert properties.model_file(settings) == folder / "mine.safetensors"


def test_every_bundled_model_has_a_small_picture_of_its_own():
    for name in BUNDLED:
        picture = pictures.picture_of(weights.MODELS / f"{name}.safetensors")
        assert picture.stem == name
        assert 2_000 < picture.stat().st_size < 30 * 1024


def test_a_model_of_ones_own_shows_what_lies_beside_it_or_a_picture_for_any(folder: Path):
    write(folder / "mine.safetensors")
    assert pictures.picture_of(folder / "mine.safetensors").name == "any.jpg"
    (folder / "mine.jpg").write_bytes((weights.MODELS / "moss.jpg").read_bytes())
    assert pictures.picture_of(folder / "mine.safetensors") == folder / "mine.jpg"


def test_models_are_found_by_what_they_are_for(empty_scene: bpy.types.Scene):
    titles = [item[1] for item in finding._found(None, bpy.context)]
    assert "Rust: Bare or painted steel" in titles
    assert "From File…" in titles
    material = bpy.data.materials.new("Any")
    bpy.ops.mesh.primitive_plane_add()
    bpy.context.object.data.materials.append(material)
    assert bpy.ops.tvbrdf.find_model(model="moss") == {"FINISHED"}
    assert material.tvbrdf.ntm == "moss"
