"""What leaves Blender with an aged material: said where textures stay behind, whole when frozen."""

from __future__ import annotations

import json
import time
from pathlib import Path

import bpy
import numpy as np
import pytest
from PIL import Image

import tvbrdf
from tests.blender.aged_cases import bind
from tests.blender.live_cases import made_up_live
from tests.blender.material_cases import image, made_up, new_material, plane, procedural
from tvbrdf.tvbrdf_addon.material.binding.freeze_live import freeze_live

pytestmark = pytest.mark.usefixtures("empty_scene")


def exported(material, folder: Path) -> tuple[dict, list[str]]:
    """The glTF of `material` by Blender's exporter, and what our hook had it warn of."""
    said = []

    class Log:
        def warning(self, message: str, popup: bool = False) -> None:
            assert popup
            said.append(message)

    hook = tvbrdf.glTF2ExportUserExtension()
    hook.gather_material_hook(None, material, {"log": Log()})
    path = folder / "scene.gltf"
    bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLTF_SEPARATE")
    (made,) = json.loads(path.read_text())["materials"]
    return made, said


@pytest.fixture
def aged(empty_scene, tmp_path: Path):
    bpy.ops.preferences.addon_enable(module="io_scene_gltf2")
    material = new_material()
    procedural(material)
    obj = plane(material)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bind(material, obj, made_up(tmp_path / "aged"), tmp_path)
    return material


def test_gltf_says_to_freeze_and_is_whole_then(aged, tmp_path):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze

    made, said = exported(aged, tmp_path)
    assert "pbrMetallicRoughness" not in made, "Blender exports sequences now: nothing to say"
    assert len(said) == 1
    assert "Freeze" in said[0]
    freeze(aged, 6)
    made, said = exported(aged, tmp_path)
    assert not said
    assert {"baseColorTexture", "metallicRoughnessTexture"} <= set(made["pbrMetallicRoughness"])
    # Of images with more than 8 bits Blender's exporter writes the linear values.
    shown = (1 + 3 * 5 / 9) / 4  # frame 6 of 1 to 10, of four stages k / 4
    texture = np.asarray(Image.open(tmp_path / "Paint base_color.png"))[..., :3] / 255
    np.testing.assert_allclose(texture, shown, atol=0.003)


def test_a_packed_file_says_what_it_leaves_out_until_frozen(aged, tmp_path):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
    from tvbrdf.tvbrdf_addon.sharing import left_out

    assert left_out(aged) is None
    other = image("Packed", np.zeros((2, 2, 3)))
    other.pack()
    assert "freeze" in left_out(aged)
    freeze(aged, 6)
    assert left_out(aged) is None
    bpy.ops.file.pack_all()
    for path in (tmp_path / "aged").iterdir():
        path.unlink()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    shown = [n.image for n in bpy.data.materials["Paint"].node_tree.nodes if n.type == "TEX_IMAGE"]
    assert shown
    for each in shown:
        assert each.packed_file
        assert tuple(each.size) == (4, 4)
        assert each.colorspace_settings.is_data
        np.testing.assert_allclose(each.pixels[0], (1 + 3 * 5 / 9) / 4, rtol=1e-3)


def test_auto_pack_counts_as_packed(aged):
    from tvbrdf.tvbrdf_addon.sharing import left_out

    bpy.data.use_autopack = True
    assert left_out(aged)
    assert left_out(new_material("Not aged")) is None


@pytest.mark.parametrize("relief", [False, True])
def test_gltf_of_what_the_shader_ages_is_told_and_soon_done(empty_scene, tmp_path, relief):
    """The exporter follows every path through the nodes, unless something ends them."""
    bpy.ops.preferences.addon_enable(module="io_scene_gltf2")
    material = new_material()
    procedural(material)
    obj = plane(material)
    more = {"height": True, "grain": 3} if relief else {}
    folder = made_up_live(tmp_path / "live", count=6, size=(32, 32), **more)
    bind(material, obj, folder, tmp_path)
    began = time.monotonic()
    _, said = exported(material, tmp_path)
    assert time.monotonic() - began < 30
    assert len(said) == 1
    assert "Freeze" in said[0]
    material.tvbrdf.folder, material.tvbrdf.size = str(folder), 32
    freeze_live(material, obj, bpy.context.scene)
    made, said = exported(material, tmp_path)
    assert len(said) == relief
    assert all("relief" in each for each in said)
    assert {"baseColorTexture", "metallicRoughnessTexture"} <= set(made["pbrMetallicRoughness"])
