"""Baking: values against formulas, slots, groups, margins, other spaces."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import read
from tests.blender.material_cases import (
    add,
    image,
    link,
    new_material,
    plane,
    principled_of,
    procedural,
    read_maps,
)

pytestmark = pytest.mark.usefixtures("empty_scene")
SIZE = 16
CENTERS = (np.arange(SIZE) + 0.5) / SIZE
U, V = np.meshgrid(CENTERS, CENTERS[::-1])  # row 0 is the top, where V is highest


def axes(material) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """U and V as numbers."""
    coordinates, split = add(material, "ShaderNodeTexCoord"), add(material, "ShaderNodeSeparateXYZ")
    material.node_tree.links.new(coordinates.outputs["UV"], split.inputs[0])
    return split.outputs[0], split.outputs[1]


def maps_of(material, obj, tmp_path) -> dict[str, np.ndarray]:
    read(material, obj, tmp_path)
    return read_maps(tmp_path / "maps")


def test_every_socket_has_its_own_values(tmp_path):
    material = new_material()
    u, v = axes(material)
    tree = material.node_tree
    combined = add(material, "ShaderNodeCombineColor")
    tree.links.new(u, combined.inputs[0])
    tree.links.new(v, combined.inputs[1])
    link(material, combined.outputs[0], "Base Color")
    for number, (socket, axis) in enumerate(
        [("Metallic", u), ("Roughness", v), ("Specular IOR Level", u), ("IOR", v)]
    ):
        scale = add(material, "ShaderNodeMath", operation="MULTIPLY")
        tree.links.new(axis, scale.inputs[0])
        scale.inputs[1].default_value = (number + 1) / 4
        link(material, scale.outputs[0], socket)
    link(material, v, "Specular Tint")
    maps = maps_of(material, plane(material), tmp_path)
    close = {"atol": 2e-4}  # Blender bakes some thousandths of a texel beside the center
    np.testing.assert_allclose(maps["BaseColor"][..., 0], U, **close)
    np.testing.assert_allclose(maps["BaseColor"][..., 1], V, **close)
    np.testing.assert_allclose(maps["BaseColor"][..., 2], 0, **close)
    np.testing.assert_allclose(maps["Metallic"][..., 0], U / 4, **close)
    np.testing.assert_allclose(maps["Roughness"][..., 0], V / 2, **close)
    np.testing.assert_allclose(maps["Specular"][..., 0], U * 0.75, **close)
    np.testing.assert_allclose(maps["IOR"][..., 0], V, **close)
    np.testing.assert_allclose(maps["SpecularTint"], V[..., None].repeat(3, 2), **close)


def test_values_are_clamped_as_the_principled_bsdf_does(tmp_path):
    material = new_material()
    u, _ = axes(material)
    wide = add(material, "ShaderNodeMapRange", clamp=False)
    wide.inputs["To Min"].default_value, wide.inputs["To Max"].default_value = -1, 2
    material.node_tree.links.new(u, wide.inputs["Value"])
    link(material, wide.outputs[0], "Roughness")
    link(material, wide.outputs[0], "Base Color")
    maps = maps_of(material, plane(material), tmp_path)
    values = -1 + 3 * U
    np.testing.assert_allclose(maps["Roughness"][..., 0], values.clip(0, 1), atol=3e-4)
    np.testing.assert_allclose(maps["BaseColor"][..., 0], values.clip(0), atol=3e-4)


def test_a_color_that_feeds_a_number_counts_by_its_luminance(tmp_path):
    material = new_material()
    u, _ = axes(material)
    combined = add(material, "ShaderNodeCombineColor")
    material.node_tree.links.new(u, combined.inputs[1])
    link(material, combined.outputs[0], "Metallic")
    found = maps_of(material, plane(material), tmp_path)["Metallic"][..., 0]
    np.testing.assert_allclose(found, 0.7152 * U, atol=1e-4)


def test_node_groups_are_baked(tmp_path):
    material = new_material()
    group = bpy.data.node_groups.new("Halve", "ShaderNodeTree")
    group.interface.new_socket("Value", in_out="INPUT", socket_type="NodeSocketFloat")
    group.interface.new_socket("Half", in_out="OUTPUT", socket_type="NodeSocketFloat")
    begin, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    half = group.nodes.new("ShaderNodeMath")
    half.operation = "MULTIPLY"
    half.inputs[1].default_value = 0.5
    group.links.new(begin.outputs[0], half.inputs[0])
    group.links.new(half.outputs[0], end.inputs[0])
    node = add(material, "ShaderNodeGroup")
    node.node_tree = group
    u, _ = axes(material)
    material.node_tree.links.new(u, node.inputs[0])
    link(material, node.outputs[0], "Roughness")
    found = maps_of(material, plane(material), tmp_path)["Roughness"][..., 0]
    np.testing.assert_allclose(found, U / 2, atol=1e-4)


def test_only_the_materials_own_faces_are_baked(tmp_path):
    """The other slot's face lies over ours in UV space and must not win."""
    material, other = new_material(), new_material("Other")
    principled_of(other).inputs["Base Color"].default_value = (1, 0, 1, 1)
    u, _ = axes(material)
    link(material, u, "Base Color")
    mesh = bpy.data.meshes.new("Two")
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    mesh.from_pydata(square + [(x, y, 1) for x, y, _ in square], [], [(0, 1, 2, 3), (4, 5, 6, 7)])
    layer = mesh.uv_layers.new()
    layer.data.foreach_set("uv", np.array([(x, y) for x, y, _ in square] * 2).ravel())
    mesh.materials.append(material)
    mesh.materials.append(other)
    mesh.polygons[1].material_index = 1
    obj = bpy.data.objects.new("Two", mesh)
    bpy.context.scene.collection.objects.link(obj)
    reading_maps = maps_of(material, obj, tmp_path)
    np.testing.assert_allclose(reading_maps["BaseColor"][..., 0], U, atol=1e-4)


def test_mixing_an_image_with_a_procedural_bakes_both_by_uv(tmp_path):
    """A tiled image and a gradient share no space of their own, so both end up in UV space."""
    material = new_material()
    codes = np.array([[0.0, 1.0], [1.0, 0.0]])[..., None].repeat(3, 2)
    node = add(
        material, "ShaderNodeTexImage", image=image("Checks", codes), interpolation="Closest"
    )
    mapping = add(material, "ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = (2, 2, 1)
    coordinates = add(material, "ShaderNodeTexCoord")
    tree = material.node_tree
    tree.links.new(coordinates.outputs["UV"], mapping.inputs[0])
    tree.links.new(mapping.outputs[0], node.inputs[0])
    link(material, node.outputs[0], "Base Color")
    link(material, axes(material)[0], "Roughness")
    obj = plane(material)
    reading = read(material, obj, tmp_path)
    assert reading.uv_map == obj.data.uv_layers[0].name
    assert reading.size == (SIZE, SIZE)
    checks = (1 + np.floor(U * 4) + np.floor(V * 4)) % 2  # white at the lower left
    found = read_maps(tmp_path / "maps")["BaseColor"][..., 0]
    np.testing.assert_allclose(found, checks, atol=1e-6)


def test_baking_is_the_same_every_time_and_shared_objects_are_warned_about(tmp_path):
    material = new_material()
    procedural(material)
    obj = plane(material)
    first = maps_of(material, obj, tmp_path)
    plane(material)
    reading = read(material, obj, tmp_path)
    assert any("1 more object" in each for each in reading.warnings)
    for name, values in read_maps(tmp_path / "maps").items():
        np.testing.assert_array_equal(values, first[name])


def test_overlapping_uvs_are_warned_about(tmp_path):
    material = new_material()
    procedural(material)
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    cube.data.materials.append(material)
    assert not read(material, cube, tmp_path).warnings
    for face in cube.data.polygons:
        corners = ((0, 0), (1, 0), (1, 1), (0, 1))
        for loop, corner in zip(face.loop_indices, corners, strict=True):
            cube.data.uv_layers[0].data[loop].uv = corner
    (warning,) = read(material, cube, tmp_path).warnings
    assert "overlap" in warning


def test_texels_beside_an_island_are_filled(tmp_path):
    material = new_material()
    link(material, add(material, "ShaderNodeTexCoord").outputs["Object"], "Base Color")
    obj = plane(material)
    for corner in obj.data.uv_layers[0].data:
        corner.uv = (corner.uv.x * 0.5 + 0.25, corner.uv.y * 0.5 + 0.25)
    found = maps_of(material, obj, tmp_path)["BaseColor"]
    assert found[SIZE // 2, 0, 0] == pytest.approx(found[SIZE // 2, SIZE // 4, 0], abs=0.1)
    assert found[SIZE // 2, -1, 0] == pytest.approx(15 / 16, abs=0.1)


def test_baking_in_edit_mode_and_of_a_hidden_object(tmp_path):
    material = new_material()
    procedural(material)
    obj = plane(material)
    first = maps_of(material, obj, tmp_path)
    obj.hide_render = True
    bpy.ops.object.mode_set(mode="EDIT")
    second = maps_of(material, obj, tmp_path)
    assert obj.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    for name in first:
        np.testing.assert_array_equal(first[name], second[name])
