"""What counts is what a render shows of an object: after modifiers, at the frame, hidden or not."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import read
from tests.blender.material_cases import (
    add,
    baked_material,
    link,
    new_material,
    plane,
    read_maps,
)
from tests.blender.object_cases import modified, with_nodes

pytestmark = pytest.mark.usefixtures("empty_scene")


# What is hidden


def _hidden(obj) -> None:
    obj.hide_render = obj.hide_viewport = True


def _excluded(obj) -> None:
    scene = bpy.context.scene
    collection = bpy.data.collections.new("Excluded")
    scene.collection.children.link(collection)
    collection.objects.link(obj)
    scene.collection.objects.unlink(obj)
    bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True


def _appears_later(obj) -> None:
    for hidden, frame in ((True, 1), (False, 50)):
        obj.hide_render = obj.hide_viewport = hidden
        obj.keyframe_insert("hide_render", frame=frame)
        obj.keyframe_insert("hide_viewport", frame=frame)
    bpy.context.scene.frame_set(1)


def _seen_by_no_ray(obj) -> None:
    for ray in ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(obj, f"visible_{ray}", False)


def _holdout(obj) -> None:
    obj.is_holdout = True


def _shadow_catcher(obj) -> None:
    obj.is_shadow_catcher = True


def _instanced_on_vertices(obj) -> None:
    parent = plane()
    parent.instance_type = "VERTS"
    obj.parent = parent
    bpy.context.view_layer.update()


@pytest.mark.parametrize(
    "hide",
    [
        *(_hidden, _excluded, _appears_later),
        *(_seen_by_no_ray, _holdout, _shadow_catcher, _instanced_on_vertices),
    ],
)
def test_a_hidden_object_is_read_as_if_it_were_seen(tmp_path, hide):
    material = baked_material()
    obj = plane(material)
    modified(obj, "SUBSURF", levels=0, render_levels=2)
    read(material, obj, tmp_path)
    seen = read_maps(tmp_path / "maps")
    hide(obj)
    read(material, obj, tmp_path)
    for name, values in read_maps(tmp_path / "maps").items():
        np.testing.assert_array_equal(values, seen[name])


def test_no_more_is_subdivided_than_the_scene_allows(tmp_path):
    material = baked_material()
    obj = plane(material)
    modifier = modified(obj, "SUBSURF", render_levels=3)
    render = bpy.context.scene.render
    render.use_simplify, render.simplify_subdivision_render = True, 0
    read(material, obj, tmp_path)
    simple = read_maps(tmp_path / "maps")
    obj.modifiers.remove(modifier)
    read(material, obj, tmp_path)
    for name, values in read_maps(tmp_path / "maps").items():
        np.testing.assert_array_equal(values, simple[name])


# Modifiers


def _taper(obj) -> None:
    modified(obj, "SIMPLE_DEFORM", deform_method="TAPER", factor=1.0)


def _smooth(obj) -> None:
    modified(obj, "SUBSURF", levels=0, render_levels=2)


def _smooth_and_taper(obj) -> None:
    _smooth(obj)
    _taper(obj)


def _shape_key(obj) -> None:
    obj.shape_key_add(name="Basis")
    key = obj.shape_key_add(name="Key")
    key.data[0].co, key.value = (3, 1, 2), 1.0
    _smooth(obj)


def _array(obj) -> None:
    modified(obj, "ARRAY")


@pytest.mark.parametrize("change", [_taper, _smooth, _smooth_and_taper, _shape_key, _array])
@pytest.mark.parametrize("coordinates", ["Generated", "Object"])
def test_coordinates_are_those_that_cycles_shows_on_the_modified_mesh(
    tmp_path, coordinates, change
):
    """Cycles' own bake of the object itself is the judge."""
    material = new_material()
    node = add(material, "ShaderNodeTexCoord")
    bpy.ops.mesh.primitive_cube_add()
    obj = bpy.context.object
    obj.data.materials.append(material)
    link(material, node.outputs[coordinates], "Base Color")
    change(obj)
    read(material, obj, tmp_path)
    found = read_maps(tmp_path / "maps")["BaseColor"]
    image = bpy.data.images.new("Judge", 16, 16, alpha=False, float_buffer=True, is_data=True)
    target, emission = add(material, "ShaderNodeTexImage"), add(material, "ShaderNodeEmission")
    target.image = image
    tree = material.node_tree
    tree.nodes.active = target
    tree.links.new(node.outputs[coordinates], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
    bpy.context.scene.render.engine, bpy.context.scene.cycles.samples = "CYCLES", 1
    bpy.ops.object.bake(type="EMIT", margin=0)
    judge = np.array(image.pixels[:]).reshape(16, 16, 4)[::-1, :, :3]
    covered = read_maps(tmp_path / "maps")["Coverage"][..., 0] > 0
    np.testing.assert_allclose(found[covered], judge[covered].clip(0), atol=1e-4)


@pytest.mark.parametrize(
    ("kind", "settings"), [("MIRROR", {}), ("ARRAY", {}), ("SOLIDIFY", {"thickness": 0.4})]
)
def test_copies_that_modifiers_make_share_a_texture(tmp_path, kind, settings):
    material = baked_material()
    obj = plane(material)
    assert not read(material, obj, tmp_path).warnings
    modified(obj, kind, **settings)
    (warning,) = read(material, obj, tmp_path).warnings
    assert "overlap in the UV map “UVMap” and will share one texture" in warning


def _set_material(obj: bpy.types.Object, material: bpy.types.Material) -> None:
    def build(group, geometry):
        node = group.nodes.new("GeometryNodeSetMaterial")
        node.inputs["Material"].default_value = material
        group.links.new(geometry, node.inputs[0])
        return node.outputs[0]

    with_nodes(obj, build)


def test_a_material_in_no_slot_that_nodes_give(tmp_path):
    from tvbrdf.tvbrdf_addon.material.reading.chosen import object_with

    material = baked_material()
    plane()
    obj = plane()
    _set_material(obj, material)
    assert object_with(material, bpy.context.scene) == obj
    assert read(material, obj, tmp_path).uv_map == "UVMap"


def test_instances_that_nodes_make_are_faces_of_the_object(tmp_path):
    """Four cubes on the corners of a plane, all with the same UVs."""
    material = baked_material()
    obj = plane(material)

    def build(group, geometry):
        points, cube, store, give = (
            group.nodes.new(f"GeometryNode{x}")
            for x in ("InstanceOnPoints", "MeshCube", "StoreNamedAttribute", "SetMaterial")
        )
        store.data_type, store.domain = "FLOAT2", "CORNER"
        store.inputs["Name"].default_value = "UVMap"
        give.inputs["Material"].default_value = material
        group.links.new(cube.outputs["Mesh"], store.inputs["Geometry"])
        value = next(each for each in store.inputs if each.name == "Value" and each.enabled)
        group.links.new(cube.outputs["UV Map"], value)
        group.links.new(store.outputs[0], give.inputs[0])
        group.links.new(geometry, points.inputs["Points"])
        group.links.new(give.outputs[0], points.inputs["Instance"])
        return points.outputs[0]

    with_nodes(obj, build)
    (warning,) = read(material, obj, tmp_path).warnings
    assert "overlap" in warning


def test_nothing_is_left_behind(tmp_path):
    material = baked_material()
    obj = plane(material)
    _smooth_and_taper(obj)
    _set_material(obj, material)
    kinds = ("scenes", "objects", "meshes", "materials", "images", "node_groups", "shape_keys")

    def everything() -> dict[str, list[str]]:
        return {kind: [each.name for each in getattr(bpy.data, kind)] for kind in kinds}

    before = everything()
    read(material, obj, tmp_path)
    assert everything() == before
    assert [each.show_viewport for each in obj.modifiers] == [True] * 3


# Texels that no face covers


def test_the_texels_that_faces_cover_are_told(tmp_path: Path):
    material = baked_material()
    bpy.ops.mesh.primitive_cube_add()
    obj = bpy.context.object
    obj.data.materials.append(material)
    assert read(material, obj, tmp_path).sampling.extension == "EXTEND"
    coverage = read_maps(tmp_path / "maps")["Coverage"]
    assert (coverage > 0).mean() == 6 / 16  # a cross of six squares in four by four


def test_a_square_that_is_covered_says_nothing_of_it(tmp_path: Path):
    material = baked_material()
    read(material, plane(material), tmp_path)
    assert "Coverage" not in read_maps(tmp_path / "maps")
