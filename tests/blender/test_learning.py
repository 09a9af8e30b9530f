"""Learn from Material: what is handed over, what becomes of the model, how it ends early."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

import bpy
import numpy as np
import pytest

from model_runtime.model_files import weights
from tests.blender.material_cases import add, image, new_material, pixels, plane, textured
from tvbrdf.tvbrdf_addon import preferences
from tvbrdf.tvbrdf_addon.errors import SettingsError, WorkerError
from tvbrdf.tvbrdf_addon.learning import Learning, lesson

STUB = Path(__file__).resolve().parents[1] / "stub_learn.py"


@pytest.fixture
def home(empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's folder of models; what learns is the stub."""
    folder = tmp_path / "models"
    monkeypatch.setattr(preferences, "models_folder", lambda: folder)
    monkeypatch.setenv("TVBRDF_WORKER", str(STUB))
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "0.2")
    return folder


def weathered(material: bpy.types.Material) -> None:
    """Images of color and roughness, with a normal map and a displacement beside them."""
    rng = np.random.default_rng(1)
    textured(material, rng.random((32, 16, 3)))
    textured(material, rng.random((32, 16, 1)).repeat(3, 2), "Roughness")
    tree = material.node_tree
    normal = add(material, "ShaderNodeNormalMap")
    made = image("Normals", np.tile((0.5, 0.25, 1.0), (32, 16, 1)))
    turned = add(material, "ShaderNodeTexImage", image=made)
    tree.links.new(turned.outputs["Color"], normal.inputs["Color"])
    principled = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    tree.links.new(normal.outputs[0], principled.inputs["Normal"])
    node = add(material, "ShaderNodeDisplacement")
    risen = add(material, "ShaderNodeTexImage", image=image("Up", np.full((32, 16, 3), 0.75)))
    tree.links.new(risen.outputs["Color"], node.inputs["Height"])
    tree.links.new(node.outputs[0], tree.get_output_node("ALL").inputs["Displacement"])


def scanned() -> bpy.types.Material:
    material = new_material("Old Door")
    weathered(material)
    plane(material)
    return material


def of(source: bpy.types.Material | Path, title: str = "My Door"):
    scene = bpy.context.scene
    return lesson(source=source, title=title, process="rust", scene=scene)


def through(learning: Learning) -> None:
    while learning.step():
        time.sleep(0.01)


def test_a_material_becomes_a_model_of_the_list(home: Path):
    material, aged = scanned(), new_material("Clean")
    plane(aged)
    settings = bpy.context.window_manager.tvbrdf_lesson
    settings.material, settings.title, settings.process = material, "My Door", "peeling_wood"
    assert bpy.ops.tvbrdf.learn() == {"FINISHED"}
    card = weights.read_card(home / "my_door.safetensors")
    assert (card.name, card.title, card.process) == ("my_door", "My Door", "peeling_wood")
    maps = set(card.description.split())
    assert {"BaseColor.exr", "Roughness.exr", "Normal.exr", "Displacement.exr"} <= maps
    assert aged.tvbrdf.ntm == "my_door"
    assert material.tvbrdf.ntm == "rust"
    assert settings.title == ""


def test_what_shapes_a_material_is_handed_over_as_it_is(home: Path, tmp_path: Path):
    from tvbrdf.tvbrdf_addon.material.reading.read import read

    material = scanned()
    read(
        material=material,
        obj=bpy.context.object,
        scene=bpy.context.scene,
        folder=tmp_path,
        size=32,
        shape=True,
    )
    normals = pixels(tmp_path / "Normal.exr")
    assert normals.shape == (32, 16, 3)
    np.testing.assert_allclose(normals[5, 5], (0.5, 0.25, 1.0), atol=1 / 255)
    heights = pixels(tmp_path / "Displacement.exr")
    np.testing.assert_allclose(heights.reshape(32, 16, -1)[..., 0], 0.75, atol=1 / 255)


def test_a_folder_of_textures_does_as_well(home: Path, tmp_path: Path):
    textures = tmp_path / "Scan_1K"
    textures.mkdir()
    (textures / "Scan_1K_Color.jpg").write_bytes(b"")
    learning = Learning(of(textures))
    through(learning)
    assert weights.read_card(home / "my_door.safetensors").description == "Scan_1K_Color.jpg"
    assert learning.fraction == pytest.approx(0.9)
    assert learning.notes == ["The stub knows no height.", "Learned from a stub."]


def test_what_cannot_be_learned_says_why_and_leaves_no_model(home: Path, tmp_path: Path):
    (tmp_path / "fail.txt").write_text("")
    with pytest.raises(WorkerError, match="It shows no two states"):
        through(Learning(of(tmp_path)))
    assert not list(home.iterdir())


def test_cancel_ends_it_soon(home: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "60")
    learning = learning_from(scanned())
    learning.cancel()
    begun = time.monotonic()
    with pytest.raises(WorkerError) as caught:
        through(learning)
    assert caught.value.code == "cancelled"
    assert time.monotonic() - begun < 5
    assert not list(home.iterdir())


def test_closing_it_lets_go_of_the_process(home: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "60")
    learning = learning_from(scanned())
    assert learners()
    learning.close()
    assert not learners()


def learning_from(source: bpy.types.Material) -> Learning:
    """One whose process has begun to learn."""
    learning = Learning(of(source))
    while learning.stage != "Learning":
        assert learning.step()
        time.sleep(0.01)
    return learning


def learners() -> list[Path]:
    """The processes that learn from here."""
    found = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            arguments = file.read_bytes().split(b"\0")
            found += [file] if str(STUB).encode() in arguments else []
    return found


@pytest.mark.parametrize(
    ("title", "said"), [("", "no name"), ("Rust", "a model called Rust already"), ("!!", "no name")]
)
def test_a_model_needs_a_name_of_its_own(home: Path, title: str, said: str):
    with pytest.raises(SettingsError, match=said):
        of(scanned(), title)


def test_a_material_that_is_the_same_everywhere_teaches_nothing(home: Path):
    material = new_material()
    plane(material)
    with pytest.raises(SettingsError, match="the same everywhere"):
        of(material)


def test_nothing_is_learned_from_nothing(home: Path):
    assert not bpy.ops.tvbrdf.learn.poll()
    assert not bpy.ops.tvbrdf.cancel_learning.poll()
    bpy.context.window_manager.tvbrdf_lesson.title = "New"
    assert not bpy.ops.tvbrdf.learn.poll()


def test_without_pytorch_it_says_what_is_missing(home: Path, monkeypatch: pytest.MonkeyPatch):
    material = scanned()
    monkeypatch.delenv("TVBRDF_WORKER")
    with pytest.raises(SettingsError, match="needs PyTorch"):
        of(material)
