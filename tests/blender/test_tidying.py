"""Results that no material shows any more are told apart from those that one does."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest

from tests.blender.test_operators import add_material, age
from tvbrdf.tvbrdf_addon import tidying

pytestmark = pytest.mark.usefixtures("stub_worker")


@pytest.fixture
def steel(empty_scene: bpy.types.Scene, tmp_path: Path) -> bpy.types.Material:
    material = add_material("Steel")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    return material


def test_aging_again_leaves_a_result_that_is_cleaned_up(steel, tmp_path: Path):
    age()
    assert tidying.left_over() == []
    age()
    assert [each.name for each in tidying.left_over()] == ["Steel"]
    assert bpy.ops.tvbrdf.clean_up() == {"FINISHED"}
    assert [each.name for each in (tmp_path / "aged").iterdir()] == ["Steel.001"]
    assert not bpy.ops.tvbrdf.clean_up.poll()


def test_what_is_no_result_or_is_shown_stays(steel, tmp_path: Path):
    age()
    bpy.ops.tvbrdf.freeze()
    (tmp_path / "aged" / "Mine").mkdir()
    (tmp_path / "aged" / "notes.txt").write_text("mine")
    copy = steel.copy()
    bpy.data.materials.remove(steel)
    assert copy.tvbrdf.folder and tidying.left_over() == []


def test_a_folder_with_anything_else_in_it_stays(steel, tmp_path: Path):
    age()
    age()
    (tmp_path / "aged" / "Steel" / "notes.txt").write_text("mine")
    assert tidying.left_over() == []


def test_what_was_aged_in_an_unsaved_file_stays(steel, tmp_path: Path, monkeypatch):
    """Another file, saved since, may show it."""
    monkeypatch.setattr(tidying.preferences, "kept_apart", lambda: tmp_path / "aged")
    age()
    age()
    assert tidying.left_over() == []


def test_a_file_without_results_has_nothing_to_clean_up(empty_scene: bpy.types.Scene):
    assert tidying.left_over() == []
    assert not bpy.ops.tvbrdf.clean_up.poll()
