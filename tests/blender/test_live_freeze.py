"""Freezing a live material: stills that look like it, whatever became of its Age."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import bind, settled
from tests.blender.live_cases import made_up_live
from tests.blender.live_materials import data_blocks, emitting, shown
from tests.blender.material_cases import (
    add,
    new_material,
    plane,
    principled_of,
    procedural,
    view_from_above,
)
from tvbrdf.tvbrdf_addon.material.binding.freeze_live import freeze_live
from tvbrdf.tvbrdf_addon.material.nodes.animation import channels, remove_keys
from tvbrdf.tvbrdf_addon.material.nodes.revert import revert
from tvbrdf.tvbrdf_addon.material.reading.pixels import read_exr
from tvbrdf.tvbrdf_addon.material.result import result_folder

pytestmark = pytest.mark.usefixtures("empty_scene")


@pytest.mark.parametrize("earlier", [False, True])
def test_freezing_leaves_stills_and_reverts(tmp_path, earlier: bool):
    material = new_material()
    procedural(material)
    obj = plane(material)
    view_from_above()
    shown(tmp_path)  # whose image stays in the file
    before, blocks = settled(material), data_blocks()
    folder = made_up_live(tmp_path / "live", count=6, size=(64, 64), grain=3, earlier=earlier)
    bind(material, obj, folder, tmp_path, span=(1, 11))
    material.tvbrdf.folder, material.tvbrdf.size = str(folder), 64
    live = material.copy()
    emitting(live)
    obj.material_slots[0].material = live
    truth = shown(tmp_path, 7, 64)
    obj.material_slots[0].material = material
    bpy.data.materials.remove(live)

    freeze_live(material, obj, bpy.context.scene)
    assert "Age" not in material
    assert not channels(material)
    textures = [node for node in material.node_tree.nodes if node.type == "TEX_IMAGE"]
    names = {f"{name}.exr" for name in ("base_color", "metallic", "specular", "roughness")}
    assert {Path(node.image.filepath).name for node in textures} == names
    still = material.copy()
    base = principled_of(still).inputs[0].links[0].from_socket
    emission = add(still, "ShaderNodeEmission")
    still.node_tree.links.new(base, emission.inputs[0])
    still.node_tree.links.new(
        emission.outputs[0], still.node_tree.get_output_node("CYCLES").inputs["Surface"]
    )
    obj.material_slots[0].material = still
    for frame in (1, 11):
        error = np.sqrt(shown(tmp_path, frame, 64)) - np.sqrt(truth)
        assert -10 * np.log10(np.mean(np.square(error))) > 40
    obj.material_slots[0].material = material
    bpy.data.materials.remove(still)
    revert(material)
    assert settled(material) == before
    assert data_blocks() == blocks


def test_freezing_says_whose_own_age_is_lost(tmp_path):
    folder = made_up_live(tmp_path / "live", size=(64, 64))
    material = new_material()
    procedural(material)
    obj, other = plane(material), plane(material)
    bind(material, obj, folder, tmp_path)
    material.tvbrdf.folder, material.tvbrdf.size = str(folder), 64
    other["Age"] = 1.0
    (warning,) = freeze_live(material, obj, bpy.context.scene)
    assert f"The Age that “{other.name}” had of its own is not kept" in warning


def delete_it(material) -> None:
    del material["Age"]


def write_in_it(material) -> None:
    del material["Age"]
    material["Age"] = "old"


def make_it_no_number(material) -> None:
    remove_keys(material, '["Age"]')
    material["Age"] = float("nan")


def drive_it(material) -> None:
    material.driver_add('["Age"]').driver.expression = "0 * 1"
    bpy.context.view_layer.update()


@pytest.mark.parametrize("change", [delete_it, write_in_it, make_it_no_number, drive_it])
def test_an_age_that_is_no_longer_ours_freezes_and_goes(tmp_path, change):
    material = new_material()
    procedural(material)
    obj = plane(material)
    before = settled(material)
    folder = made_up_live(tmp_path / "live", size=(64, 64))
    bind(material, obj, folder, tmp_path, span=(1, 11))
    material.tvbrdf.folder, material.tvbrdf.size = str(folder), 64
    bpy.context.scene.frame_set(1)  # of age 0, on which all of these are, too
    assert freeze_live(material, obj, bpy.context.scene) == ()
    young = read_exr(folder / "frame 1" / "base_color.exr")
    revert(material)
    bind(material, obj, folder, tmp_path, span=(1, 11))
    material.tvbrdf.folder = str(folder)
    bpy.context.scene.frame_set(11)
    change(material)
    freeze_live(material, obj, bpy.context.scene)
    np.testing.assert_array_equal(read_exr(folder / "frame 11" / "base_color.exr"), young)
    revert(material)
    assert settled(material) == before
    assert material.animation_data is None or not material.animation_data.drivers


def test_a_file_that_was_saved_elsewhere_finds_its_result(tmp_path):
    material = new_material()
    procedural(material)
    obj = plane(material)
    folder = made_up_live(tmp_path / "here" / "live", size=(16, 16))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "here" / "file.blend"))
    bind(material, obj, folder, tmp_path, span=(1, 11))
    material.tvbrdf.folder, material.tvbrdf.size = "//live", 16
    elsewhere = tmp_path / "far" / "away" / "file.blend"
    elsewhere.parent.mkdir(parents=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(elsewhere))
    assert result_folder(material).samefile(folder)
    freeze_live(material, obj, bpy.context.scene)
    stills = [node.image for node in material.node_tree.nodes if node.type == "TEX_IMAGE"]
    assert all(Path(bpy.path.abspath(image.filepath)).is_file() for image in stills)
