"""Aging the same again in Blender takes what was kept: after a revert, under another name, in
another file; and what is kept can be deleted.
"""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.material_cases import image, link, new_material, plane
from tvbrdf.model_runtime.contract import CACHE_SECONDS, REPORT
from tvbrdf.model_runtime.output.kept import Kept
from tvbrdf.tvbrdf_addon import session
from tvbrdf.tvbrdf_addon.material.nodes.revert import revert


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Kept:
    monkeypatch.setenv("TVBRDF_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("TVBRDF_WORKER", raising=False)
    return Kept(tmp_path / "cache", 0)


def painted(name: str) -> bpy.types.Material:
    """A textured material that ages over a plane in a few small steps."""
    material = new_material(name)
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image(name, np.random.default_rng(0).random((16, 16, 3), np.float32))
    node.image.pack()
    link(material, node.outputs["Color"], "Base Color")
    plane(material)
    material.tvbrdf.steps, material.tvbrdf.size = 3, 16
    material.tvbrdf.use_camera_size = False
    return material


def aged(material: bpy.types.Material) -> tuple[bool, dict[str, bytes]]:
    """Whether a result that was kept is shown, and its files."""
    run = session.age_and_wait(material, bpy.context.scene)
    files = {path.name: path.read_bytes() for path in run.plan.folder.iterdir()}
    assert REPORT in files
    return CACHE_SECONDS in run.aged, {name: files[name] for name in files if name != REPORT}


@pytest.mark.usefixtures("empty_scene")
def test_the_same_is_aged_once_wherever_it_is(cache: Kept, tmp_path: Path):
    paint = painted("Paint")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "one.blend"))
    taken, first = aged(paint)
    assert not taken
    revert(paint)
    assert aged(paint) == (True, first)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    (tmp_path / "elsewhere").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "elsewhere" / "two.blend"))
    assert aged(painted("Lacquer")) == (True, first)
    other = painted("Other")
    other.tvbrdf.seed = 1
    assert not aged(other)[0]
    assert len(list(cache.folder.glob("*.zip"))) == 2


@pytest.mark.usefixtures("empty_scene")
def test_what_is_kept_can_be_deleted(cache: Kept):
    cache.folder.mkdir()
    (cache.folder / f"{0:064x}.zip").write_bytes(bytes(1000))
    (cache.folder / "notes.txt").write_text("mine")
    assert bpy.ops.tvbrdf.clear_kept() == {"CANCELLED"}
    assert bpy.ops.tvbrdf.clear_kept(folder=str(cache.folder)) == {"FINISHED"}
    assert [path.name for path in cache.folder.iterdir()] == ["notes.txt"]
