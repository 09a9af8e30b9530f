"""A file that 0.1 aged, sequences moved by a node called Age: it opens, reverts and ages again.

`aged_by_0_1.blend` holds “Paint”, four frames in `//aged/Paint` over the frames 1 to 10, and
“Plain”, keyed sockets.  It was written by 0.1 itself, in Blender 4.5.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import emitting
from tests.blender.material_cases import made_up, principled_of, render, view_from_above
from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
from tvbrdf.tvbrdf_addon.material.nodes.animation import channels
from tvbrdf.tvbrdf_addon.material.nodes.record import is_live
from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged, revert

HERE = Path(__file__).resolve().parent
pytestmark = pytest.mark.skipif(bpy.app.version < (4, 5), reason="the file is of Blender 4.5")


@pytest.fixture
def paint(empty_scene: bpy.types.Scene, tmp_path: Path) -> bpy.types.Material:
    made_up(tmp_path / "aged" / "Paint")
    shutil.copy(HERE / "aged_by_0_1.blend", tmp_path / "scene.blend")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    return bpy.data.materials["Paint"]


def test_it_plays(paint: bpy.types.Material, tmp_path: Path):
    emitting(paint)
    bpy.data.objects["Plane.001"].hide_render = True
    view_from_above()
    for frame, shown in ((1, 1), (6, 8 / 3), (10, 4)):
        picture = render(tmp_path / "shown.exr", frame, size=4, samples=1)
        np.testing.assert_allclose(picture, shown / 4, rtol=2e-3)


def test_its_range_moves(paint: bpy.types.Material):
    paint.tvbrdf.frame_end = 19
    (curve,) = channels(paint.node_tree)
    assert [point.co.x for point in curve.keyframe_points] == [1, 19]
    plain = bpy.data.materials["Plain"]
    plain.tvbrdf.frame_end = 19
    keyed = [each for each in channels(plain.node_tree) if "Age" not in each.data_path]
    assert keyed
    for curve in keyed:
        assert [point.co.x for point in curve.keyframe_points] == [1, 7, 13, 19]


def test_it_freezes(paint: bpy.types.Material):
    freeze(paint, 10)
    textures = [node for node in paint.node_tree.nodes if node.type == "TEX_IMAGE"]
    assert {node.image.source for node in textures} == {"FILE"}
    assert not paint.node_tree.animation_data.drivers


@pytest.mark.parametrize("name", ["Paint", "Plain"])
def test_it_reverts(paint: bpy.types.Material, name: str):
    material = bpy.data.materials[name]
    revert(material)
    assert not is_aged(material)
    assert not [node for node in material.node_tree.nodes if "tvbrdf" in node]
    assert material.node_tree.animation_data is None
    assert principled_of(material).inputs["Base Color"].is_linked == (name == "Paint")


@pytest.mark.usefixtures("stub_worker")
def test_it_ages_again_as_all_do_now(paint: bpy.types.Material):
    paint.tvbrdf.size = 16
    assert bpy.ops.tvbrdf.age_material(material="Paint") == {"FINISHED"}
    assert is_live(paint)
    assert "Age" in paint
    assert not [image for image in bpy.data.images if image.source == "SEQUENCE"]
    revert(paint)
    assert not [node for node in paint.node_tree.nodes if "tvbrdf" in node]
