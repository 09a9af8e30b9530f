"""Several materials in one action, and settings that go from one to others or are kept."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest

from tests.blender.test_operators import add_material
from tvbrdf.tvbrdf_addon import ageing, presets
from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged

pytestmark = pytest.mark.usefixtures("stub_worker")


@pytest.fixture
def three(empty_scene: bpy.types.Scene, tmp_path: Path) -> list[bpy.types.Material]:
    """Materials of three selected objects in a saved file."""
    materials = [add_material(name) for name in ("Steel", "Copper", "Stone")]
    for obj in empty_scene.objects:
        obj.select_set(True)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    return materials


def test_all_materials_of_selected_objects_age_each_once(three):
    bpy.context.object.data.materials.append(three[0])  # in a second slot
    assert ageing.materials_of_selected(bpy.context) == three
    assert bpy.ops.tvbrdf.age_materials() == {"FINISHED"}
    assert all(map(is_aged, three))


def test_what_cannot_be_aged_is_left_out(three):
    three[1].node_tree.nodes.clear()
    assert bpy.ops.tvbrdf.age_materials() == {"FINISHED"}
    assert [is_aged(each) for each in three] == [True, False, True]


def test_where_none_can_be_aged_the_first_says_why(three):
    for material in three:
        material.node_tree.nodes.clear()
    with pytest.raises(RuntimeError, match="“Steel” is left out"):
        bpy.ops.tvbrdf.age_materials()


def test_nothing_is_selected(three):
    for obj in bpy.context.scene.objects:
        obj.select_set(False)
    assert not bpy.ops.tvbrdf.age_materials.poll()


CHANGED = {
    "ntm": "moss",
    "steps": 7,
    "size": 512,
    "use_camera_size": True,
    "seed": 3,
    "amount": 0.5,
}


def change(material: bpy.types.Material) -> None:
    settings = material.tvbrdf
    for name, value in CHANGED.items():
        setattr(settings, name, value)
    settings.use_own_exposure = True
    settings.exposure.edges = -0.25


def is_changed(material: bpy.types.Material) -> bool:
    settings = material.tvbrdf
    kept = all(getattr(settings, name) == value for name, value in CHANGED.items())
    return kept and settings.use_own_exposure and settings.exposure.edges == -0.25


def test_settings_are_copied_to_the_other_materials(three):
    change(three[2])  # of the active object
    assert bpy.ops.tvbrdf.copy_settings() == {"FINISHED"}
    assert all(map(is_changed, three))


def test_settings_are_kept_as_a_preset_without_what_is_of_one_file(
    three, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("BLENDER_USER_RESOURCES", str(tmp_path))
    change(three[2])
    three[2].tvbrdf.output = "/somewhere"
    lines = presets.TVBRDF_OT_add_preset.preset_values.fget(None)
    assert "settings.exposure.edges" in lines
    assert not {"settings.output", "settings.original", "settings.suggested"} & set(lines)
    kept = [(line, eval(line, {"settings": three[2].tvbrdf})) for line in lines]
    for line, value in kept:
        exec(f"{line} = {value!r}", {"settings": three[0].tvbrdf})
    assert is_changed(three[0])
    assert three[0].tvbrdf.output == "//aged"
