"""Which object a material is read from."""

from __future__ import annotations

import bpy
import pytest

from tests.blender.aged_cases import read, refusal
from tests.blender.material_cases import new_material, plane, procedural
from tests.blender.object_cases import modified
from tvbrdf.tvbrdf_addon.material.nodes.surface import find_principled

pytestmark = pytest.mark.usefixtures("empty_scene")


def chosen(material: bpy.types.Material) -> str:
    from tvbrdf.tvbrdf_addon.material.reading.chosen import object_with

    bpy.context.view_layer.update()
    found = object_with(material, bpy.context.scene)
    return found.name if found is not None else ""


def named(material: bpy.types.Material, name: str, *, faces: bool = True) -> bpy.types.Object:
    """A plane with the material in its second slot, on its face or on none."""
    obj = plane(new_material("Other"))
    obj.name = name
    obj.data.materials.append(material)
    obj.data.polygons[0].material_index = int(faces)
    return obj


def activate(obj: bpy.types.Object | None) -> None:
    bpy.context.view_layer.objects.active = obj


def test_the_one_whose_faces_show_it():
    material = new_material()
    named(material, "A", faces=False)
    named(material, "B")
    activate(bpy.data.objects["A"])
    assert chosen(material) == "B"


def test_not_one_whose_faces_modifiers_take_away():
    material = new_material()
    first = named(material, "A")
    modified(first, "MASK", vertex_group=first.vertex_groups.new(name="None").name)
    named(material, "B")
    activate(first)
    assert chosen(material) == "B"


def test_the_active_one_before_a_visible_one():
    material = new_material()
    for name in "ABC":
        named(material, name)
    activate(bpy.data.objects["B"])
    assert chosen(material) == "B"
    activate(None)
    bpy.data.objects["A"].hide_set(True)
    bpy.data.objects["B"].hide_viewport = True
    assert chosen(material) == "C"


def test_one_with_uvs_before_one_without():
    material = new_material()
    first, second = named(material, "A"), named(material, "B")
    first.data.uv_layers.remove(first.data.uv_layers[0])
    assert chosen(material) == "B"
    activate(second)
    bpy.ops.object.mode_set(mode="EDIT")
    assert chosen(material) == "B"


def instanced(obj: bpy.types.Object) -> bpy.types.Object:
    """Takes the object out of the scene; an empty shows it instead."""
    scene = bpy.context.scene
    collection = bpy.data.collections.new("Parts")
    collection.objects.link(obj)
    scene.collection.objects.unlink(obj)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    scene.collection.objects.link(empty)
    return empty


def test_one_that_is_only_instanced(tmp_path):
    material = new_material()
    procedural(material)
    part = named(material, "Part")
    instanced(part)
    assert chosen(material) == "Part"
    assert read(material, part, tmp_path).uv_map == "UVMap"


def test_one_of_another_scene_that_is_instanced_here_and_else_its_scene_is_named(tmp_path):
    material = new_material()
    part = named(material, "Part")
    empty = instanced(part)
    assets = bpy.data.scenes.new("Assets")
    assets.collection.children.link(bpy.data.collections["Parts"])
    assert chosen(material) == "Part"
    bpy.data.objects.remove(empty)
    assert chosen(material) == ""
    said = refusal(material, None, tmp_path)
    assert said.startswith("“Paint” is shown by “Part” of the scene “Assets”: switch to that scene")


def test_where_no_object_shows_it_the_slot_is_named(tmp_path):
    said = refusal(new_material(), None, tmp_path)
    assert "select an object that uses it in one of its material slots" in said


@pytest.mark.parametrize(
    "add_one", [bpy.ops.object.text_add, bpy.ops.curve.primitive_bezier_circle_add]
)
def test_a_start_everywhere_at_once_needs_no_uvs(tmp_path, add_one):
    material = new_material()
    add_one()
    obj = bpy.context.object
    obj.data.materials.append(material)
    assert refusal(material, obj, tmp_path).endswith(", or set Start to Everywhere at Once.")
    material.tvbrdf.onset = "none"
    assert read(material, obj, tmp_path).uniform


def test_a_name_that_is_no_way_out_is_not_given(tmp_path):
    """What has to be baked needs UVs however it starts."""
    material = new_material()
    procedural(material)
    obj = plane(material)
    obj.data.uv_layers.remove(obj.data.uv_layers[0])
    assert "Everywhere" not in refusal(material, obj, tmp_path)


def test_named_objects():
    from tvbrdf.tvbrdf_addon.errors import SettingsError
    from tvbrdf.tvbrdf_addon.material.reading.chosen import object_named

    material, scene = new_material(), bpy.context.scene
    named(material, "A")
    wanted = named(material, "B", faces=False)
    plane().name = "Bare"
    bpy.data.scenes.new("Elsewhere").collection.objects.link(bpy.data.objects.new("Far", None))
    assert object_named("B", material, scene) == wanted
    for name, words in (
        ("C", "no object called C. Paint is shown by A, B."),
        ("Bare", "The object Bare does not show Paint. Paint is shown by A, B."),
        ("Far", "The object Far is in the scene Elsewhere, not in Scene."),
    ):
        with pytest.raises(SettingsError) as caught:
            object_named(name, material, scene)
        assert words in str(caught.value)


def test_an_object_without_a_material_gets_one():
    bpy.ops.object.light_add()
    assert not bpy.ops.tvbrdf.new_material.poll()
    bpy.ops.object.empty_add()
    assert not bpy.ops.tvbrdf.new_material.poll()
    bpy.ops.mesh.primitive_plane_add()
    assert bpy.ops.tvbrdf.new_material() == {"FINISHED"}
    assert find_principled(bpy.context.object.active_material)
