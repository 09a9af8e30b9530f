"""What the panel says before the click: size, time and disk, and what it learns from runs."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import pytest

from tests.blender.material_cases import add, link, new_material, plane, view_from_above
from tvbrdf.tvbrdf_addon import outlook as module
from tvbrdf.tvbrdf_addon.outlook import Outlook, learn, outlook_of
from tvbrdf.tvbrdf_addon.rates import Rates, Work

pytestmark = pytest.mark.usefixtures("empty_scene")


@pytest.fixture
def paint() -> bpy.types.Material:
    """Paint with an image of 1024 x 512 on a plane that 256 pixels see from above."""
    material = new_material()
    node = add(material, "ShaderNodeTexImage", image=bpy.data.images.new("image", 1024, 512))
    link(material, node.outputs["Color"], "Base Color")
    plane(material)
    view_from_above()
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = 256
    bpy.context.evaluated_depsgraph_get()
    return material


def looked(material: bpy.types.Material) -> Outlook | None:
    """The outlook after the timer, which does not run without a window."""
    outlook_of(material, bpy.context.scene)
    module._look_in_time()
    return outlook_of(material, bpy.context.scene)


def test_nothing_is_said_before_anything_was_looked_at(paint):
    assert outlook_of(paint, bpy.context.scene) is None


def test_size_time_and_disk(paint):
    paint.tvbrdf.steps, paint.tvbrdf.temporal_model = 10, "affine"
    paint.tvbrdf.use_camera_size = True
    expected = looked(paint)
    assert expected.size == (256, 512)
    assert expected.why == "512 px is all the cameras see on this frame, of 1024 in the images."
    work = Work(256 * 512, 10, "balanced", "affine", live=True, grows=True, maps=True)
    assert expected.estimate == Rates().of(work)
    paint.tvbrdf.onset = "none"
    at_once = outlook_of(paint, bpy.context.scene).estimate
    assert at_once == Rates().of(Work(256 * 512, 10, "balanced", "affine", live=True))
    assert at_once.seconds < expected.estimate.seconds


def test_images_keep_their_size(paint):
    looked(paint)
    for baked in (128, 4096):
        paint.tvbrdf.size = baked
        assert outlook_of(paint, bpy.context.scene).size == (512, 1024)
        assert outlook_of(paint, bpy.context.scene).why == ""


def test_exact_takes_as_long_as_it_takes(paint):
    looked(paint)
    paint.tvbrdf.quality, paint.tvbrdf.temporal_model = "exact", "lstm_latents"
    expected = outlook_of(paint, bpy.context.scene)
    assert expected.estimate.seconds > 3600 > expected.balanced.seconds


def test_a_uniform_material_without_a_pattern_needs_one_texel():
    material = new_material()
    material.tvbrdf.onset = "none"
    bpy.context.evaluated_depsgraph_get()
    assert looked(material).size == (1, 1)


def test_a_material_that_cannot_be_read_has_no_forecast(paint):
    paint.node_tree.nodes.clear()
    assert looked(paint) is None


def test_runs_are_learned_from_and_kept(paint, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(module.preferences, "user_file", lambda name: tmp_path / name)
    result = tmp_path / "Paint"
    result.mkdir()
    (result / "base_color_0001.exr").write_bytes(b"0" * 1000)
    aged = {
        "size": [1024, 1024],
        "frames": 36,
        "quality": "draft",
        "temporal_model": "affine",
        "seconds": {"read": 1.0, "onset": 1.0, "model": 1.0, "write": 5.0},
    }
    learn(paint, aged, result)
    kept = json.loads((tmp_path / "rates.json").read_text())
    assert kept["write"]["draft"] == pytest.approx(
        (5 / (36 * 1024**2) + Rates().write["draft"]) / 2
    )
    assert Rates.load(tmp_path / "rates.json") == module._rates
    before = module._rates
    learn(paint, aged | {"cache_seconds": 0.1}, result)
    assert module._rates == before


def test_maps_that_are_kept_are_not_made_again(paint, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(module.preferences, "user_file", lambda name: None)
    before = looked(paint)
    aged = {
        "size": [512, 1024],
        "frames": 36,
        "quality": "balanced",
        "temporal_model": "affine",
        "binding": "live",
        "surface": {},
        "seconds": {"read": 0.1, "onset": 1.5, "model": 0.1, "fit": 0.3, "write": 0.1},
    }
    learn(paint, aged, tmp_path, before=0.5, maps=2.5)
    after = outlook_of(paint, bpy.context.scene)
    assert before.estimate.seconds - after.estimate.seconds == pytest.approx(2.5, abs=0.8)


def test_a_look_that_fails_is_said_and_ends_no_timer_with_a_traceback(paint, monkeypatch, capsys):
    def fail(*_: object) -> None:
        raise ZeroDivisionError("of nobody's making")

    monkeypatch.setattr(module, "_look", fail)
    assert looked(paint) is None
    said = capsys.readouterr().err
    assert "This should not happen (ZeroDivisionError" in said
    assert "Traceback" not in said
