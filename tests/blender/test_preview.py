"""The preview that a window shows while the run goes on: replaced by the result, or taken back."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import bpy
import pytest

from tests.blender.material_cases import snapshot
from tests.blender.test_operators import add_material, ending, image_folders, steel
from tvbrdf.tvbrdf_addon import session
from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged
from tvbrdf.tvbrdf_addon.outlook import is_worth_a_preview
from tvbrdf.tvbrdf_addon.run import Run

pytestmark = pytest.mark.usefixtures("stub_worker")


@pytest.fixture
def folder(empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a saved file with a material, Steel, of which textures of 512 px are made."""
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "1")
    material = add_material("Steel")
    material.tvbrdf.size, material.tvbrdf.onset, material.tvbrdf.steps = 512, "auto", 20
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    return tmp_path


def previewed() -> Run:
    """A run that shows its preview and has begun on the result."""
    run = session.begin(steel(), bpy.context.scene, preview=True)
    while not (run.previewing and run.fraction > 0):
        assert run.step()
    return run


def test_it_is_shown_and_then_replaced(folder: Path):
    run = previewed()
    assert is_aged(steel())
    assert steel().tvbrdf.is_preview
    assert image_folders(steel()) == {f"preview-{steel().session_uid}"}
    assert not (folder / "aged" / "Steel").exists()
    while run.step():
        pass
    session.finish(run, icon="NONE", sentences=())
    assert image_folders(steel()) == {"Steel"}
    assert not steel().tvbrdf.is_preview
    assert run.warnings == ["The stub paints flat colors."], "the preview's own are not repeated"


def test_cancelling_leaves_the_material_as_it_was(folder: Path):
    before = snapshot(steel())
    run = previewed()
    run.cancel()
    assert ending(run).code == "cancelled"
    assert snapshot(steel()) == before
    assert not steel().tvbrdf.is_preview


def test_so_does_a_worker_that_dies(folder: Path):
    before = snapshot(steel())
    run = previewed()
    os.kill(session._warm_worker().pid, signal.SIGKILL)
    ending(run)
    assert snapshot(steel()) == before


def test_so_does_an_undo(folder: Path):
    bpy.ops.ed.undo_push(message="first")
    steel().tvbrdf.seed = 3
    bpy.ops.ed.undo_push(message="second")
    run = previewed()
    # Something else is done meanwhile, and undone: the preview is part of what undo brings back.
    bpy.ops.ed.undo_push(message="meanwhile")
    bpy.context.object.location.x = 1
    bpy.ops.ed.undo_push(message="moved")
    bpy.ops.ed.undo()
    assert "undo" in str(ending(run))
    assert not is_aged(steel())


def test_it_is_not_saved(folder: Path):
    run = previewed()
    bpy.ops.wm.save_mainfile()
    assert not is_aged(steel())
    run.cancel()
    ending(run)
    bpy.ops.wm.open_mainfile(filepath=str(folder / "file.blend"))
    assert not is_aged(steel())


def test_an_aged_material_keeps_what_it_shows(folder: Path):
    assert bpy.ops.tvbrdf.age_material() == {"FINISHED"}
    before = snapshot(steel())
    run = session.begin(steel(), bpy.context.scene, preview=True)
    while not run.fraction > 0:
        assert run.step()
    assert not run.previewing
    assert snapshot(steel()) == before
    run.cancel()
    ending(run)
    assert snapshot(steel()) == before


def test_small_textures_and_quick_runs_have_none(folder: Path):
    assert not is_worth_a_preview(steel(), bpy.context.scene)
    steel().tvbrdf.size = 128
    run = session.begin(steel(), bpy.context.scene, preview=True)
    while run.step():
        assert not run.previewing
    session.finish(run, icon="NONE", sentences=())
    assert image_folders(steel()) == {"Steel"}
