"""Materials and objects that cannot be read: refused with a sentence, and left as they are."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import read, refusal
from tests.blender.material_cases import (
    add,
    baked_material,
    link,
    new_material,
    plane,
    principled_of,
    procedural,
    read_maps,
    snapshot,
    textured,
)
from tests.blender.object_cases import modified, with_nodes

pytestmark = pytest.mark.usefixtures("empty_scene")


def _emission(material) -> None:
    tree = material.node_tree
    surface = tree.get_output_node("CYCLES").inputs["Surface"]
    tree.links.new(add(material, "ShaderNodeEmission").outputs[0], surface)


def _mix(material) -> None:
    tree = material.node_tree
    surface = tree.get_output_node("CYCLES").inputs["Surface"]
    tree.links.new(add(material, "ShaderNodeMixShader").outputs[0], surface)


def _no_surface(material) -> None:
    material.node_tree.links.clear()


def _no_output(material) -> None:
    nodes = material.node_tree.nodes
    nodes.remove(material.node_tree.get_output_node("CYCLES"))


def _muted(material) -> None:
    principled_of(material).mute = True


def _no_image(material) -> None:
    link(material, add(material, "ShaderNodeTexImage").outputs[0], "Base Color")


def _missing_image(material) -> None:
    made = bpy.data.images.new("Lost", 4, 4)
    made.source = "FILE"
    made.filepath = "/nowhere/lost.png"
    link(material, add(material, "ShaderNodeTexImage", image=made).outputs[0], "Base Color")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_emission, "an Emission shader"),
        (_mix, "a Mix Shader"),
        (_no_surface, "Nothing is connected"),
        (_no_output, "no Material Output"),
        (_muted, "muted"),
        (_no_image, "has no image"),
        (_missing_image, "cannot be loaded"),
    ],
)
def test_unreadable_materials_are_refused_with_a_sentence(tmp_path, spoil, words):
    material = new_material()
    spoil(material)
    obj = plane(material)
    before = snapshot(material)
    assert words in refusal(material, obj, tmp_path)
    assert snapshot(material) == before


def test_objects_without_uvs_are_refused_where_uvs_are_needed(tmp_path):
    material = new_material()
    procedural(material)
    obj = plane(material)
    assert "select an object" in refusal(material, None, tmp_path)
    assert "does not use" in refusal(material, plane(), tmp_path)
    obj.data.uv_layers.remove(obj.data.uv_layers[0])
    assert "no UV map" in refusal(material, obj, tmp_path)
    bpy.ops.mesh.primitive_plane_add()
    tiled = bpy.context.object
    tiled.data.materials.append(material)
    for corner in tiled.data.uv_layers[0].data:
        corner.uv *= 4
    assert "outside the square" in refusal(material, tiled, tmp_path)
    bpy.ops.curve.primitive_bezier_circle_add()
    curve = bpy.context.object
    curve.data.materials.append(material)
    assert "no mesh" in refusal(material, curve, tmp_path)


def test_a_linked_material_is_refused_with_the_way_out(tmp_path):
    from tvbrdf.tvbrdf_addon.material.reading.check import why_not

    new_material("Steel").use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, wanted):
        wanted.materials = ["Steel"]
    assert "Make Local" in why_not(bpy.data.materials["Steel"], None)


@pytest.mark.parametrize(
    ("socket", "value"), [("Base Color", 1e5), ("IOR", 2e3), ("Specular IOR Level", 200.0)]
)
def test_numbers_beyond_all_surfaces_are_refused_by_the_sockets_name(tmp_path, socket, value):
    material = new_material()
    material.tvbrdf.onset = "none"
    number = add(material, "ShaderNodeValue")
    number.outputs[0].default_value = value
    link(material, number.outputs[0], socket)
    said = refusal(material, None, tmp_path)
    assert said.startswith(f"The {socket} of the material is above ")
    assert said.endswith("Lower what feeds it.")


def test_a_division_by_zero_is_refused(tmp_path):
    material = new_material()
    values = np.full((2, 2, 3), np.nan, np.float32)
    textured(material, values, floating=True)
    assert "not a number" in refusal(material, plane(material), tmp_path)


# What Cycles would die of


def _build(obj) -> None:
    modified(obj, "BUILD")


def _mask(obj) -> None:
    modified(obj, "MASK", vertex_group=obj.vertex_groups.new(name="None").name)


def _masked_in_renders_only(obj) -> None:
    _mask(obj)
    obj.modifiers[0].show_viewport = False


def _all_deleted(obj) -> None:
    def build(group, geometry):
        node = group.nodes.new("GeometryNodeDeleteGeometry")
        group.links.new(geometry, node.inputs[0])
        return node.outputs[0]

    with_nodes(obj, build)


def _without_area(obj) -> None:
    for vertex in obj.data.vertices:
        vertex.co = (0, 0, 0)


def _flattened(obj) -> None:
    modified(obj, "SIMPLE_DEFORM", deform_method="STRETCH", factor=-1.0)
    modified(obj, "CAST", factor=1.0, size=1e-9, use_radius_as_size=False)


def _other_material(obj) -> None:
    obj.data.materials.append(new_material("Other"))
    obj.data.polygons[0].material_index = 1


def _other_material_by_nodes(obj) -> None:
    other = new_material("Other")

    def build(group, geometry):
        node = group.nodes.new("GeometryNodeSetMaterial")
        node.inputs["Material"].default_value = other
        group.links.new(geometry, node.inputs[0])
        return node.outputs[0]

    with_nodes(obj, build)


def _no_uvs(obj) -> None:
    modified(obj, "REMESH")


def _scaled_to_nothing(obj) -> None:
    obj.scale = (0, 0, 0)


def _uvs_on_one_point(obj) -> None:
    for corner in obj.data.uv_layers[0].data:
        corner.uv = (0.3, 0.3)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_build, "“Plane” has no faces at frame 1: its modifiers leave none"),
        (_mask, "“Plane” has no faces at frame 1"),
        (_masked_in_renders_only, "“Plane” has no faces at frame 1"),
        (_all_deleted, "“Plane” has no faces at frame 1"),
        (_without_area, "have no area at frame 1"),
        (_other_material, "No face of “Plane” shows “Paint”"),
        (_other_material_by_nodes, "No face of “Plane” shows “Paint”"),
        (_no_uvs, "The modifiers of “Plane” leave no UV map"),
        (_uvs_on_one_point, "has no area"),
        (_scaled_to_nothing, "Cycles finds nothing of “Plane” to bake"),
    ],
)
def test_what_cannot_be_baked_is_refused_in_a_sentence(tmp_path, spoil, words):
    material = baked_material()
    obj = plane(material)
    spoil(obj)
    assert words in refusal(material, obj, tmp_path)


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf, 1e30])
def test_places_that_are_no_numbers(tmp_path, number):
    material = baked_material()
    obj = plane(material)
    obj.data.vertices[0].co.x = number
    if np.isnan(number):  # Blender makes it 0
        read(material, obj, tmp_path)
        assert all(np.isfinite(values).all() for values in read_maps(tmp_path / "maps").values())
    else:  # of which Cycles shows nothing
        assert "Cycles finds nothing of “Plane” to bake" in refusal(material, obj, tmp_path)
    obj.data.uv_layers[0].data[2].uv.x = number
    if np.isnan(number):
        read(material, obj, tmp_path)
    else:
        assert "outside the square" in refusal(material, obj, tmp_path)
    material = new_material()
    obj.data.materials[0] = material
    read(material, obj, tmp_path)


def test_faces_that_come_later_are_baked_then(tmp_path):
    material = baked_material()
    material.tvbrdf.frame_start, material.tvbrdf.frame_end = 300, 400
    obj = plane(material)
    _build(obj)
    assert read(material, obj, tmp_path).size == (16, 16)


def test_nodes_that_tell_a_view_from_a_render_apart(tmp_path):
    """There is no looking at the mesh of a render beforehand: what was looked at is baked."""

    def build(group, geometry):
        view, switch = (group.nodes.new(f"GeometryNode{x}") for x in ("IsViewport", "Switch"))
        switch.input_type = "GEOMETRY"
        group.links.new(view.outputs[0], switch.inputs["Switch"])
        group.links.new(geometry, switch.inputs["True"])
        return switch.outputs[0]

    material = baked_material()
    obj = plane(material)
    with_nodes(obj, build)
    assert read(material, obj, tmp_path).size == (16, 16)


def test_memory_that_is_not_there_is_not_asked_for(monkeypatch):
    from tvbrdf.tvbrdf_addon.errors import MaterialError
    from tvbrdf.tvbrdf_addon.material.reading import pixels

    pixels.require_memory((1024, 1024), 100)
    sizes = {"SC_PHYS_PAGES": 1000, "SC_PAGE_SIZE": 4096}
    monkeypatch.setattr(pixels.os, "sysconf", sizes.get)
    with pytest.raises(MaterialError, match=r"1024 x 1024 px need 0 GB of memory.*smaller size"):
        pixels.require_memory((1024, 1024), 100)
