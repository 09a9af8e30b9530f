"""A live material: what is added to the file, what moves it, what it survives, how it goes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import bind, settled
from tests.blender.live_cases import made_up_live
from tests.blender.live_materials import aged, data_blocks, emitting, flat, group_node, shown
from tests.blender.material_cases import (
    add,
    awkward,
    image,
    link,
    new_material,
    plane,
    principled_of,
    procedural,
    render,
    snapshot,
    view_from_above,
)
from tests.blender.surface_cases import in_nested_groups
from tvbrdf.tvbrdf_addon.material.nodes.animation import channels
from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged, revert

pytestmark = pytest.mark.usefixtures("empty_scene")
FORMATS = ("principled", "principled-exact", "torrance-sparrow")
ROOT = Path(__file__).resolve().parents[2]


def test_few_nodes_join_the_artists_and_one_driver_moves_them(tmp_path):
    material, _ = aged(tmp_path)
    added = [node for node in material.node_tree.nodes if "tvbrdf" in node]
    assert sorted(node.type for node in added) == ["FRAME", "GROUP", "UVMAP", "VALUE"]
    (driver,) = material.node_tree.animation_data.drivers
    assert driver.data_path == 'nodes["Age"].outputs[0].default_value'
    assert driver.driver.is_simple_expression
    (curve,) = channels(material)
    assert curve.data_path == '["Age"]'
    assert [tuple(point.co) for point in curve.keyframe_points] == [(1, 0), (11, 1)]
    inputs = {each.name: each for each in group_node(material).inputs}
    assert inputs["Base Color"].links[0].from_node.type == "VALTORGB"
    assert {image.source for image in bpy.data.images if "tvbrdf" in image} == {"FILE"}


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("build", [procedural, awkward, in_nested_groups])
def test_revert_leaves_nothing(tmp_path, kind, build):
    material = new_material()
    build(material)
    obj = plane(material)
    before, blocks = settled(material), data_blocks()
    bind(material, obj, made_up_live(tmp_path / "live", kind), tmp_path)
    assert is_aged(material)
    assert settled(material) != before
    revert(material)
    after = settled(material)
    for key in before:
        assert after[key] == before[key], key
    assert data_blocks() == blocks
    assert "Age" not in material


def test_a_material_that_is_animated_gets_its_own_keys_back(tmp_path):
    material = new_material()
    procedural(material)
    material["Age"] = "of the artist"
    material.keyframe_insert("roughness", frame=3)
    obj = plane(material)
    before = settled(material)
    curves = [(each.data_path, len(each.keyframe_points)) for each in channels(material)]
    bind(material, obj, made_up_live(tmp_path / "live"), tmp_path)
    assert material["Age"] == "of the artist"
    assert '["Age 2"]' in {each.data_path for each in channels(material)}
    revert(material)
    assert settled(material) == before
    assert [(e.data_path, len(e.keyframe_points)) for e in channels(material)] == curves
    assert material["Age"] == "of the artist"


def test_materials_share_what_they_can(tmp_path):
    first, _ = aged(tmp_path)
    groups = len(bpy.data.node_groups)
    second, _ = aged(tmp_path)
    assert len(bpy.data.node_groups) == groups + 1
    revert(first)
    assert len(bpy.data.node_groups) == groups
    assert group_node(second).node_tree.users == 1
    revert(second)
    assert not len(bpy.data.node_groups)


def test_muted_links_and_values_reach_the_group(tmp_path):
    def build(material):
        tint = add(material, "ShaderNodeRGB")
        tint.outputs[0].default_value = (1, 0, 0, 1)
        link(material, tint.outputs[0], "Base Color")
        inputs = principled_of(material).inputs
        inputs["Base Color"].links[0].is_muted = True
        inputs["Base Color"].default_value = (0.2, 0.4, 0.6, 1)
        inputs["IOR"].default_value = 1.7

    material, _ = aged(tmp_path, build)
    inputs = group_node(material).inputs
    assert inputs["Base Color"].links[0].is_muted
    np.testing.assert_allclose(inputs["Base Color"].default_value, (0.2, 0.4, 0.6, 1))
    assert inputs["IOR"].default_value == pytest.approx(1.7)
    emitting(material)
    view_from_above()
    picture = render(tmp_path / "a.exr", 1, size=4, samples=1)
    np.testing.assert_array_equal(picture, np.broadcast_to(np.float32((0.2, 0.4, 0.6)), (4, 4, 3)))


def test_values_that_the_artist_animates_are_animated_on(tmp_path):
    def build(material):
        inputs = principled_of(material).inputs
        for frame, value in ((1, 1.2), (9, 2.0)):
            inputs["IOR"].default_value = value
            inputs["IOR"].keyframe_insert("default_value", frame=frame)
        inputs["Roughness"].driver_add("default_value").driver.expression = "frame / 20"

    material = new_material()
    build(material)
    obj = plane(material)
    before = settled(material)
    bind(material, obj, made_up_live(tmp_path / "live"), tmp_path, span=(1, 11))
    inputs = {each.name: each for each in group_node(material).inputs}
    for frame in (1, 4, 9):
        bpy.context.scene.frame_set(frame)
        own = principled_of(material).inputs["IOR"].default_value
        assert inputs["IOR"].default_value == pytest.approx(own)
        assert inputs["Roughness"].default_value == pytest.approx(frame / 20)
    revert(material)
    assert settled(material) == before


def test_one_that_was_animated_before_ages_at_once(tmp_path):
    material = new_material()
    procedural(material)
    material.keyframe_insert("diffuse_color", frame=1)
    obj = plane(material)
    bpy.context.view_layer.update()
    bind(material, obj, made_up_live(tmp_path / "live"), tmp_path, span=(1, 11))
    bpy.context.scene.frame_set(11)
    seen = material.evaluated_get(bpy.context.evaluated_depsgraph_get())
    assert seen["Age"] == 1.0


def test_no_dependency_cycle_is_printed(tmp_path):
    """Live and frames, bound, played, copied and reloaded, in a Blender whose output is read."""
    script = (
        "import sys, bpy\n"
        "from pathlib import Path\n"
        "import tests.conftest, tvbrdf\n"
        "tvbrdf.register()\n"
        "from tests.blender.live_materials import aged\n"
        "from tests.blender.material_cases import made_up, new_material, plane, procedural\n"
        "from tests.blender.aged_cases import bind\n"
        "folder = Path(sys.argv[1])\n"
        "first, _ = aged(folder)\n"
        "second = new_material('Second')\n"
        "procedural(second)\n"
        "bind(second, plane(second), made_up(folder / 'frames'), folder)\n"
        "second.copy()\n"
        "for frame in (1, 4, 9):\n"
        "    bpy.context.scene.frame_set(frame)\n"
        "bpy.ops.wm.save_as_mainfile(filepath=str(folder / 'scene.blend'))\n"
        "bpy.ops.wm.open_mainfile(filepath=str(folder / 'scene.blend'))\n"
        "bpy.context.scene.frame_set(5)\n"
        "print('went through')\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
        check=False,
    )
    assert "went through" in run.stdout, run.stdout[-3000:]
    assert "dependency cycle" not in run.stdout.lower(), run.stdout


def test_textures_are_looked_up_as_the_artists_are(tmp_path):
    def build(material):
        texture = add(
            material,
            "ShaderNodeTexImage",
            image=image("Wood", np.random.default_rng(0).random((8, 4, 3))),
            extension="EXTEND",
            interpolation="Closest",
        )
        mapping = add(material, "ShaderNodeMapping")
        mapping.inputs["Scale"].default_value = (3, 2, 1)
        coordinates = add(material, "ShaderNodeTexCoord")
        links = material.node_tree.links
        links.new(coordinates.outputs["UV"], mapping.inputs[0])
        links.new(mapping.outputs[0], texture.inputs[0])
        link(material, texture.outputs[0], "Base Color")

    material, _ = aged(tmp_path, build)
    node = group_node(material)
    assert node.inputs["Vector"].links[0].from_node.type == "MAPPING"
    textures = [each for each in node.node_tree.nodes if each.type == "TEX_IMAGE"]
    assert len(textures) == 2  # timing, and four coefficients
    for each in textures:
        assert (each.extension, each.interpolation) == ("EXTEND", "Closest")
        assert each.inputs["Vector"].links[0].from_socket.name == "Vector"


def test_udim_tiles_lie_in_one_texture(tmp_path):
    from tvbrdf.tvbrdf_addon.material.binding.bind import bind as bind_material
    from tvbrdf.tvbrdf_addon.material.reading.lookup import Reading, TextureSize
    from tvbrdf.tvbrdf_addon.material.reading.tiles import Tiles

    material = new_material()
    plane(material)
    tiles = Tiles(used=((0, 0), (1, 0)))
    reading = Reading((8, 16), TextureSize(8, ""), False, None, (), tiles=tiles)
    folder = made_up_live(tmp_path / "live", size=(8, 16))
    bind_material(material=material, reading=reading, folder=folder, frame_start=1, frame_end=11)
    node = group_node(material)
    mapping = node.inputs["Vector"].links[0].from_node
    assert tuple(mapping.inputs["Scale"].default_value) == (0.5, 1, 1)
    textures = [each for each in node.node_tree.nodes if each.type == "TEX_IMAGE"]
    assert {each.extension for each in textures} == {"EXTEND"}


def test_what_is_saved_ages_without_the_extension_and_without_scripts(tmp_path):
    material, _ = aged(tmp_path, flat, onset=False, count=0)
    emitting(material)
    view_from_above()
    bpy.context.scene.view_settings.view_transform = "Raw"
    with_extension = shown(tmp_path, 6, 4)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    script = (
        "import sys, bpy\n"
        "bpy.ops.wm.open_mainfile(filepath=sys.argv[1], use_scripts=False)\n"
        "assert not hasattr(bpy.types.Material, 'tvbrdf')\n"
        "scene = bpy.context.scene\n"
        "scene.frame_set(6)\n"
        "scene.render.filepath = sys.argv[2]\n"
        "bpy.ops.render.render(write_still=True)\n"
    )
    from tests.blender.material_cases import pixels

    target = tmp_path / "without.exr"
    subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "scene.blend"), str(target)], check=True
    )
    np.testing.assert_array_equal(pixels(target), with_extension)


def test_reloaded_it_is_reverted(tmp_path):
    material, obj = aged(tmp_path, awkward)
    revert(material)
    before = settled(material)
    bind(material, obj, tmp_path / "live principled", tmp_path, span=(1, 11))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    material = bpy.data.materials["Paint"]
    revert(material)
    after = settled(material)
    for key in ("nodes", "links", "animation"):
        assert after[key] == before[key], key
    assert snapshot(material)["original"] == ""
