"""What Blender is told of, and that it forgets all of it again."""

from __future__ import annotations

import bpy
import pytest

import tvbrdf
from tvbrdf.tvbrdf_addon import addon, session

OPERATORS = ("age_material", "cancel", "revert", "freeze")


def registered() -> set[str]:
    return {name for name in dir(bpy.types) if "tvbrdf" in name.lower()}


def handlers() -> int:
    kinds = (getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers))
    return sum(len(kind) for kind in kinds if isinstance(kind, list))


def test_operators_panels_and_settings(empty_scene: bpy.types.Scene):
    assert {f"TVBRDF_OT_{name}" for name in OPERATORS} <= registered()
    assert "NODE_PT_tvbrdf_age" in registered()
    assert "MATERIAL_PT_tvbrdf_age" in registered()
    assert bpy.data.materials.new("Steel").tvbrdf.output == "//aged"


def test_unregistering_leaves_nothing_and_can_be_repeated(empty_scene: bpy.types.Scene):
    with_it = registered(), handlers()
    for _ in range(3):
        tvbrdf.unregister()
        assert registered() == set()
        assert not hasattr(bpy.types.Material, "tvbrdf")
        assert handlers() < with_it[1]
        tvbrdf.register()
        assert (registered(), handlers()) == with_it


def test_unregistering_stops_the_worker(empty_scene: bpy.types.Scene):
    worker = session._warm_worker()
    worker.start()
    process = worker._process
    tvbrdf.unregister()
    try:
        assert process.poll() is not None
    finally:
        tvbrdf.register()


@pytest.mark.parametrize("cls", addon.CLASSES)
def test_every_button_and_setting_explains_itself(empty_scene: bpy.types.Scene, cls: type):
    if issubclass(cls, bpy.types.Operator):
        tip = getattr(bpy.ops.tvbrdf, cls.bl_idname.partition(".")[2]).get_rna_type().description
        assert tip
        # Blender adds the full stop to every tooltip.
        assert not tip.endswith(".")
    for prop in cls.bl_rna.properties:
        own = prop.identifier in getattr(cls, "__annotations__", {})
        if own:
            assert prop.description, f"{cls.__name__}.{prop.identifier}"
            assert not prop.description.endswith("."), f"{cls.__name__}.{prop.identifier}"


def test_settings_survive_saving(empty_scene: bpy.types.Scene, tmp_path):
    settings = bpy.data.materials.new("Steel").tvbrdf
    bpy.data.materials["Steel"].use_fake_user = True
    settings.ntm, settings.steps, settings.onset, settings.format = "rust", 7, "none", "exact"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    settings = bpy.data.materials["Steel"].tvbrdf
    assert (settings.ntm, settings.steps) == ("rust", 7)
    assert (settings.onset, settings.format) == ("none", "exact")


def test_a_frame_range_set_by_hand_replaces_the_scenes(empty_scene: bpy.types.Scene):
    from tvbrdf.tvbrdf_addon.material.nodes.age import frame_range

    material = bpy.data.materials.new("Steel")
    empty_scene.frame_start, empty_scene.frame_end = 10, 90
    assert frame_range(material, empty_scene) == (10, 90)
    material.tvbrdf.frame_start, material.tvbrdf.frame_end = 5, 40
    assert frame_range(material, empty_scene) == (5, 40)
