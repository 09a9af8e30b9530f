"""Binding an aged result: what moves, what stays, what travels with the file."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import bind, emitting
from tests.blender.material_cases import (
    add,
    image,
    link,
    made_up,
    new_material,
    plane,
    principled_of,
    procedural,
    render,
    snapshot,
    view_from_above,
    write_map,
    write_result,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


def sockets_of(material):
    return principled_of(material).inputs


def test_age_is_a_keyed_property_and_drivers_are_simple(tmp_path):
    material = new_material()
    procedural(material)
    bind(material, plane(material), made_up(tmp_path / "aged"), tmp_path, span=(5, 25))
    from tvbrdf.tvbrdf_addon.material.nodes.animation import channels

    (curve,) = channels(material)
    assert curve.data_path == '["Age"]'
    assert [tuple(p.co) for p in curve.keyframe_points] == [(5, 0), (25, 1)]
    assert {p.interpolation for p in curve.keyframe_points} == {"LINEAR"}
    settings = material.id_properties_ui("Age").as_dict()
    assert (settings["min"], settings["max"]) == (0, 1)
    drivers = material.node_tree.animation_data.drivers
    assert len(drivers) == 4 * 3
    assert all(each.driver.is_simple_expression for each in drivers)
    targets = [each.driver.variables[0].targets[0] for each in drivers]
    assert {(each.id, each.data_path) for each in targets} == {(material, '["Age"]')}


@pytest.mark.parametrize(
    ("frame", "shown"),
    [(-20, 1), (1, 1), (2, 4 / 3), (4, 2), (6, 8 / 3), (7, 3), (10, 4), (400, 4)],
)
def test_what_is_shown_follows_age_and_holds_outside_the_range(tmp_path, frame, shown):
    material = new_material()
    procedural(material)
    obj = plane(material)
    view_from_above()
    bind(material, obj, made_up(tmp_path / "aged"), tmp_path)
    emitting(material)
    picture = render(tmp_path / "shown.exr", frame, size=4, samples=1)
    np.testing.assert_allclose(picture, shown / 4, rtol=2e-3)


@pytest.mark.parametrize(
    "stored", [(0, 9), (0, 2, 9), (0, 1, 5, 9), (0, 3, 4, 8, 9), tuple(range(10))]
)
def test_frames_that_are_not_stored_lie_between_those_that_are(tmp_path, stored):
    """Every whole and half modeled frame shows what `aged.json` says, frame 4.5 its middle."""
    import json

    material = new_material()
    procedural(material)
    obj = plane(material)
    view_from_above()
    folder = made_up(tmp_path / "aged", count=10)
    values = np.interp(np.arange(0, 9.5, 0.5), stored, [(k % 4 + 1) / 10 for k in stored])
    data = json.loads((folder / "aged.json").read_text())
    mixes = []
    for k in range(10):
        start = max(i for i, each in enumerate(stored) if each <= k)
        share = (
            (k - stored[start]) / (stored[start + 1] - stored[start])
            if start < len(stored) - 1
            else 0
        )
        pair = [[f"base_color_{stored[start] + 1:04d}.exr", 1 - share]]
        mixes.append(
            pair + ([[f"base_color_{stored[start + 1] + 1:04d}.exr", share]] if share else [])
        )
    data["files"]["base_color"] = mixes
    (folder / "aged.json").write_text(json.dumps(data))
    for k in range(10):
        file = folder / f"base_color_{k + 1:04d}.exr"
        file.unlink() if k not in stored else write_map(file, np.full((4, 4, 3), (k % 4 + 1) / 10))
    bind(material, obj, folder, tmp_path, span=(1, 19))
    emitting(material)
    for i, value in enumerate(values):
        picture = render(tmp_path / "shown.exr", i + 1, size=2, samples=1)
        np.testing.assert_allclose(picture, value, rtol=2e-3, err_msg=f"frame {i / 2}")


def test_moving_the_keys_of_age_retimes(tmp_path):
    material = new_material()
    procedural(material)
    obj = plane(material)
    view_from_above()
    bind(material, obj, made_up(tmp_path / "aged"), tmp_path)
    emitting(material)
    from tvbrdf.tvbrdf_addon.material.nodes.animation import channels

    for curve in channels(material):
        for point, at in zip(curve.keyframe_points, (101, 110), strict=True):
            point.co.x = at
        curve.update()
    np.testing.assert_allclose(render(tmp_path / "a.exr", 50, size=4, samples=1), 0.25, rtol=2e-3)
    np.testing.assert_allclose(render(tmp_path / "b.exr", 110, size=4, samples=1), 1, rtol=2e-3)


def test_uniform_material_gets_keyed_sockets_and_no_textures(tmp_path):
    material = new_material()
    material.tvbrdf.onset = "none"
    plane(material)
    before = snapshot(material)
    values = [0.2, 0.4, 0.8]
    maps = {
        "base_color": [np.full((1, 1, 3), v) for v in values],
        "metallic": [np.zeros((1, 1))] * 3,
        "specular": [np.full((1, 1), 0.5)] * 3,
        "roughness": [np.full((1, 1), v) for v in values],
    }
    folder = write_result(tmp_path / "aged", "principled", maps)
    bind(material, None, folder, tmp_path, span=(1, 101))
    for path in folder.iterdir():
        path.unlink()
    assert not [n for n in material.node_tree.nodes if n.type == "TEX_IMAGE"]
    for frame, value in ((1, 0.2), (26, 0.3), (51, 0.4), (76, 0.6), (101, 0.8), (500, 0.8)):
        bpy.context.scene.frame_set(frame)
        inputs = sockets_of(material)
        assert inputs["Roughness"].default_value == pytest.approx(value, rel=1e-3)
        np.testing.assert_allclose(inputs["Base Color"].default_value[:3], value, rtol=1e-3)
        assert inputs["Metallic"].default_value == 0
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    revert(material)
    assert snapshot(material) == before


def test_the_roughness_between_stored_frames_is_that_of_the_alpha_between(tmp_path):
    """Alpha straight from 0.01 to 0.81 in four frames, of which the ends are stored."""
    import json

    material = new_material()
    material.tvbrdf.onset = "none"
    plane(material)
    maps = {name: [np.full((1, 1, 3), 0.25)] * 4 for name in ("kd", "ks")}
    maps["alpha"] = [np.full((1, 1), alpha) for alpha in (0.01, 0.5, 0.5, 0.81)]
    folder = write_result(tmp_path / "aged", "torrance-sparrow", maps)
    data = json.loads((folder / "aged.json").read_text())
    ends = "alpha_0001.exr", "alpha_0004.exr"
    between = [[[ends[0], 1 - share], [ends[1], share]] for share in (1 / 3, 2 / 3)]
    data["files"]["alpha"] = [[[ends[0], 1.0]], *between, [[ends[1], 1.0]]]
    (folder / "aged.json").write_text(json.dumps(data))
    bind(material, None, folder, tmp_path, span=(1, 4))
    glossy = next(n for n in material.node_tree.nodes if n.type == "BSDF_GLOSSY")
    for frame, alpha in ((1, 0.01), (2, 0.27667), (3, 0.54333), (4, 0.81)):
        bpy.context.scene.frame_set(frame)
        assert glossy.inputs["Roughness"].default_value == pytest.approx(alpha**0.5, rel=2e-3)


def test_a_map_that_never_changes_keeps_what_fed_it(tmp_path):
    material = new_material()
    procedural(material)
    metallic = sockets_of(material)["Metallic"].links[0].from_node.name
    folder = made_up(tmp_path / "aged")
    same = (folder / "metallic_0001.exr").read_bytes()
    for path in folder.glob("metallic_*.exr"):
        path.write_bytes(same)
    bind(material, plane(material), folder, tmp_path)
    assert sockets_of(material)["Metallic"].links[0].from_node.name == metallic
    assert "tvbrdf" in sockets_of(material)["Roughness"].links[0].from_node


def test_images_keep_their_mapping(tmp_path):
    material = new_material()
    tree = material.node_tree
    texture = add(
        material,
        "ShaderNodeTexImage",
        image=image("Wood", np.random.default_rng(0).random((8, 4, 3))),
        extension="EXTEND",
        interpolation="Closest",
    )
    coordinates, mapping = add(material, "ShaderNodeTexCoord"), add(material, "ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = (3, 2, 1)
    tree.links.new(coordinates.outputs["UV"], mapping.inputs[0])
    tree.links.new(mapping.outputs[0], texture.inputs[0])
    link(material, texture.outputs[0], "Base Color")
    bind(material, plane(material), made_up(tmp_path / "aged"), tmp_path)
    fade = sockets_of(material)["Base Color"].links[0].from_node
    for played in (each.links[0].from_node for each in fade.inputs if each.is_linked):
        assert played.inputs["Vector"].links[0].from_node == mapping
        assert (played.extension, played.interpolation) == ("EXTEND", "Closest")


def test_paths_are_relative_to_a_saved_file(tmp_path):
    material = new_material()
    procedural(material)
    obj = plane(material)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bind(material, obj, made_up(tmp_path / "aged" / "Paint"), tmp_path)
    paths = {n.image.filepath for n in material.node_tree.nodes if n.type == "TEX_IMAGE"}
    assert "//aged/Paint/base_color_0001.exr" in {path.replace("\\", "/") for path in paths}


def test_two_materials_do_not_touch_each_other(tmp_path):
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    first, second = new_material("First"), new_material("Second")
    for material in (first, second):
        procedural(material)
    before = snapshot(first)
    second_obj = plane(second)
    bind(second, second_obj, made_up(tmp_path / "two"), tmp_path)
    bpy.context.scene.frame_set(1)
    aged = snapshot(second)
    bind(first, plane(first), made_up(tmp_path / "one"), tmp_path)
    revert(first)
    assert {**snapshot(second), "images": None} == {**aged, "images": None}
    now = snapshot(first)
    assert all(now[key] == before[key] for key in ("nodes", "links", "animation", "original"))


def test_aging_again_starts_from_the_original_and_leaves_no_images(tmp_path):
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material = new_material()
    procedural(material)
    obj = plane(material)
    before = snapshot(material)
    bind(material, obj, made_up(tmp_path / "one"), tmp_path)
    images = len(bpy.data.images)
    bind(material, obj, made_up(tmp_path / "two", "torrance-sparrow"), tmp_path)
    assert len(bpy.data.images) == images - 2  # four maps, then three, two textures each
    revert(material)
    assert snapshot(material) == before


def test_a_copy_of_an_aged_material_reverts_alone(tmp_path):
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material = new_material()
    procedural(material)
    bind(material, plane(material), made_up(tmp_path / "one"), tmp_path)
    aged = snapshot(material)
    copy = material.copy()
    revert(copy)
    assert snapshot(material) == aged


@pytest.mark.parametrize("spoil", ["missing", "mixes", "format", "damaged", "no json"])
def test_a_bad_result_is_refused_and_changes_nothing(tmp_path, spoil):
    import json

    from tvbrdf.tvbrdf_addon.errors import MaterialError

    material = new_material()
    procedural(material)
    obj = plane(material)
    folder = made_up(tmp_path / "aged")
    data = json.loads((folder / "aged.json").read_text())
    if spoil == "missing":
        (folder / "roughness_0003.exr").unlink()
    elif spoil == "mixes":
        data["files"]["roughness"] = [[["metallic_0001.exr", 1.0]]] * 4
    elif spoil == "format":
        data["format"] = "spectral"
    (folder / "aged.json").write_text("{" if spoil == "damaged" else json.dumps(data))
    if spoil == "no json":
        (folder / "aged.json").unlink()
    before = snapshot(material)
    with pytest.raises(MaterialError) as caught:
        bind(material, obj, folder, tmp_path)
    assert caught.value.message.endswith(".")
    assert caught.value.hint
    assert snapshot(material) == before


def test_normals_emission_and_alpha_outlive_torrance_sparrow(tmp_path):
    material = new_material()
    procedural(material)
    tree, inputs = material.node_tree, sockets_of(material)
    bump = add(material, "ShaderNodeBump")
    tree.links.new(bump.outputs[0], inputs["Normal"])
    inputs["Emission Strength"].default_value = 2.0
    inputs["Alpha"].default_value = 0.5
    inputs["Coat Weight"].default_value = 0.3
    warnings = bind(
        material, plane(material), made_up(tmp_path / "aged", "torrance-sparrow"), tmp_path
    )
    assert len(warnings) == 1
    assert "coat" in warnings[0]
    normals = {link.to_node.type for link in bump.outputs[0].links}
    assert normals == {"BSDF_PRINCIPLED", "BSDF_DIFFUSE", "BSDF_GLOSSY"}
    mix = tree.get_output_node("CYCLES").inputs["Surface"].links[0].from_node
    assert mix.type == "MIX_SHADER"
    assert mix.inputs[0].default_value == 0.5


def test_a_copy_follows_its_own_age(tmp_path):
    material = new_material()
    procedural(material)
    bind(material, plane(material), made_up(tmp_path / "one"), tmp_path)
    copy = material.copy()
    for driver in copy.node_tree.animation_data.drivers:
        assert driver.driver.variables[0].targets[0].id == copy
