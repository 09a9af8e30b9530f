"""Maps of the surface: what a render shows of all that has a material, texel by texel."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests.blender.material_cases import new_material, plane
from tests.blender.object_cases import modified, with_nodes
from tests.blender.surface_truth import (
    SIZE,
    cube,
    errors,
    everything,
    maps_of,
    monkey,
    read_map,
    surface_points,
    texels,
    tiled,
    unwrap,
    without_uvs,
    written,
)

pytestmark = pytest.mark.usefixtures("empty_scene")
# Where things are


def test_a_plane_is_known_to_the_digit(tmp_path):
    material = new_material()
    plane(material)
    maps = maps_of(material, tmp_path)
    rows, columns = np.mgrid[0:SIZE, 0:SIZE]
    position, normal = maps["position"], maps["normal"]
    np.testing.assert_allclose(position[..., 0], (columns + 0.5) / SIZE * 2 - 1, atol=1e-6)
    np.testing.assert_allclose(position[..., 1], 1 - (rows + 0.5) / SIZE * 2, atol=1e-6)
    np.testing.assert_array_equal(position[..., 2], 0)
    np.testing.assert_array_equal(normal[..., :3], np.broadcast_to([0, 0, 1], (SIZE, SIZE, 3)))
    assert (position[..., 3] == 1).all()
    np.testing.assert_array_equal(maps["ao"], 1)
    np.testing.assert_array_equal(maps["edge"], 0)
    np.testing.assert_array_equal(maps["sky"], 1)


def block(material) -> bpy.types.Object:
    obj = cube(material, scale=(1, 1, 2), rotation=(0.3, 0.2, 0.1), location=(5, -3, 1))
    unwrap(obj)
    return obj


@pytest.mark.parametrize("make", [block, monkey])
def test_each_place_of_a_surface_lies_in_its_texel(tmp_path, make):
    """Ground truth: places on the evaluated mesh, one by one."""
    material = new_material()
    obj = make(material)
    maps = maps_of(material, tmp_path, size=256)
    distance = errors(maps, obj)
    texel = np.sqrt(
        2 * sum(each.area for each in obj.data.polygons) / (maps["position"][..., 3].sum())
    )
    assert np.quantile(distance, 0.97) < 2 * texel
    assert distance.max() < 10 * texel, "at borders, at most that of a neighbor"
    covered = maps["position"][..., 3] > 0
    assert 0.2 < covered.mean() < 0.95
    length = np.linalg.norm(maps["normal"][..., :3], axis=2)
    np.testing.assert_allclose(length[covered], 1, atol=1e-5)
    _, uv, normals = surface_points(obj)
    agree = (texels(maps["normal"], uv)[:, :3] * normals).sum(1)
    assert np.median(agree) > 0.99


def test_margins_go_on_and_are_not_covered(tmp_path):
    material = new_material()
    block(material)
    position = maps_of(material, tmp_path)["position"]
    beside = (position[..., 3] == 0) & (np.abs(position[..., :3]).sum(2) > 0)
    assert beside.any()
    assert set(np.unique(position[..., 3])) == {0, 1}


def test_crevices_edges_and_the_sky(tmp_path):
    """A step: a small block on the middle of a big one, in one mesh."""
    material = new_material()
    big = cube(material, scale=(2, 2, 0.5))
    small = cube(material, scale=(0.7, 0.7, 0.5), location=(0, 0, 1))
    unwrap(big, small)
    maps = maps_of(material, tmp_path, size=256)
    position = maps["position"]
    size = maps["ao"].shape[0]
    rows, columns = (np.mgrid[0:size, 0:size] + 0.5) * 256 / size
    near = position[rows.astype(int), columns.astype(int)]
    up = maps["normal"][rows.astype(int), columns.astype(int)][..., 2]
    x, y, z, covered = np.moveaxis(near, 2, 0)
    from_small = np.maximum(np.abs(x), np.abs(y)) - 0.7
    top = (covered > 0) & (up > 0.9) & (np.abs(z - 0.5) < 0.01) & (from_small > 0.02)
    rim = 2 - np.maximum(np.abs(x), np.abs(y))
    assert (
        maps["ao"][top & (from_small < 0.08)].mean()
        < maps["ao"][top & (from_small > 0.8)].mean() - 0.15
    )
    assert maps["edge"][top & (rim < 0.03)].mean() > 0.4, "three texels are half the reach"
    assert maps["edge"][top & (rim > 0.4)].mean() < 0.1
    assert maps["sky"][top & (from_small > 1)].mean() > 0.85
    assert maps["sky"][(covered > 0) & (up < -0.9)].mean() < 0.02
    walls = (covered > 0) & (np.abs(up) < 0.1)
    assert 0.3 < maps["sky"][walls].mean() < 0.55


def test_what_stands_around_shelters(tmp_path):
    material = new_material()
    plane(material)
    bpy.ops.mesh.primitive_plane_add(size=8, location=(0, 0, 0.3))
    roof = bpy.context.object
    assert maps_of(material, tmp_path)["sky"].mean() < 0.2
    roof.hide_render = True
    assert maps_of(material, tmp_path)["sky"].min() == 1
    roof.hide_render, roof.display_type = False, "WIRE"
    assert maps_of(material, tmp_path)["sky"].min() == 1


def test_a_plane_that_looks_down_sees_no_sky(tmp_path):
    material = new_material()
    plane(material).rotation_euler = (np.pi, 0, 0)
    assert maps_of(material, tmp_path)["sky"].max() < 1e-3


# Several objects


def test_several_objects_share_a_map(tmp_path):
    material = new_material()
    first, second = cube(material), cube(material, location=(4, 0, 0))
    unwrap(first, second)
    maps = maps_of(material, tmp_path)
    texel = 2 / (SIZE / 6)
    assert np.quantile(errors(maps, first), 0.9) < texel
    assert np.quantile(errors(maps, second), 0.9) < texel


def test_faces_with_other_materials_are_left_out_and_shelter(tmp_path):
    material = new_material()
    obj = cube(material)
    unwrap(obj)
    obj.data.materials.append(new_material("Other"))
    for face in obj.data.polygons:
        face.material_index = int(face.normal.z < 0.5)
    maps = maps_of(material, tmp_path)
    covered = maps["position"][..., 3] > 0
    np.testing.assert_allclose(maps["position"][covered][:, 2], 1, atol=1e-5)
    assert 0.02 < covered.mean() < 0.2


def test_hidden_objects_count_where_no_other_shows_the_material(tmp_path):
    material = new_material()
    first, hidden = plane(material), plane(material)
    hidden.location.z = 9
    hidden.hide_render = True
    assert maps_of(material, tmp_path)["position"][..., 2].max() == 0
    bpy.data.objects.remove(first)
    assert maps_of(material, tmp_path)["position"][..., 2].min() == 9


def test_objects_of_collections_that_are_not_rendered(tmp_path):
    material = new_material()
    plane(material)
    other = plane(material)
    other.location.z = 9
    collection = bpy.data.collections.new("Backup")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(other)
    bpy.context.scene.collection.objects.unlink(other)
    collection.hide_render = True
    maps = written(material, tmp_path)
    assert maps.own is None
    assert read_map(maps.folder, "position")[..., 2].max() == 0


def test_linked_duplicates_age_alike_and_this_is_said(tmp_path):
    material = new_material()
    first = plane(material)
    for x in (3, 6):
        duplicate = first.copy()
        duplicate.location.x = x
        bpy.context.scene.collection.objects.link(duplicate)
    maps = written(material, tmp_path)
    assert maps.own is None
    assert "2 linked duplicates or instances of “Plane” age as it does" in maps.notes[0]
    assert read_map(maps.folder, "position")[..., 0].max() < 1


def test_instances_of_a_collection_stand_where_they_are_seen(tmp_path):
    material = new_material()
    obj = plane(material)
    collection = bpy.data.collections.new("Tile")
    collection.objects.link(obj)
    bpy.context.scene.collection.objects.unlink(obj)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    empty.location.z = 4
    bpy.context.scene.collection.objects.link(empty)
    bpy.context.view_layer.update()
    position = maps_of(material, tmp_path)["position"]
    np.testing.assert_allclose(position[..., 2], 4)


# Transforms, modifiers, frames


def test_scale_and_parents_count_and_a_mirror_keeps_the_outside(tmp_path):
    material = new_material()
    obj = plane(material)
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    obj.parent, parent.scale, parent.location = parent, (3, -2, 0.5), (0, 0, 7)
    bpy.context.view_layer.update()
    maps = maps_of(material, tmp_path)
    position = maps["position"]
    np.testing.assert_allclose(np.abs(position[..., 0]).max(), 3 * (1 - 1 / SIZE), atol=1e-5)
    np.testing.assert_allclose(np.abs(position[..., 1]).max(), 2 * (1 - 1 / SIZE), atol=1e-5)
    assert position[0, 0, 1] < 0, "mirrored"
    np.testing.assert_allclose(position[..., 2], 7)
    np.testing.assert_allclose(maps["normal"][..., 2], 1)
    np.testing.assert_array_equal(maps["sky"], 1)


def test_flipped_normals_point_outward(tmp_path):
    material = new_material()
    obj = block(material)
    right = maps_of(material, tmp_path)
    obj.data.flip_normals()
    flipped = maps_of(material, tmp_path)
    np.testing.assert_allclose(flipped["normal"], right["normal"], atol=1e-5)
    assert np.abs(flipped["ao"] - right["ao"]).mean() < 0.02
    assert np.abs(flipped["sky"] - right["sky"]).mean() < 0.02
    obj.data.polygons[2].flip()
    np.testing.assert_allclose(maps_of(material, tmp_path)["normal"], right["normal"], atol=1e-5)


def test_modifiers_are_applied_as_renders_do(tmp_path):
    material = new_material()
    obj = monkey(material)
    smooth = modified(obj, "SUBSURF", levels=0, render_levels=2)
    maps = maps_of(material, tmp_path, size=256)
    smooth.levels = 2
    bpy.context.view_layer.update()
    assert np.quantile(errors(maps, obj), 0.95) < 0.05


def test_what_is_animated_counts_at_the_first_frame(tmp_path):
    material = new_material()
    obj = plane(material)
    for frame, z in ((1, 5), (10, 0)):
        obj.location.z = z
        obj.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(10)
    np.testing.assert_allclose(maps_of(material, tmp_path)["position"][..., 2], 5)
    assert bpy.context.scene.frame_current == 10


@pytest.mark.parametrize(("kind", "axis"), [("ARRAY", 0), ("MIRROR", 0)])
def test_copies_that_modifiers_make_age_alike_and_this_is_said(tmp_path, kind, axis):
    material = new_material()
    obj = plane(material)
    for vertex in obj.data.vertices:
        vertex.co[axis] += 3
    modified(obj, kind)
    maps = written(material, tmp_path)
    assert maps.own is None
    assert "Copies that modifiers make" in maps.notes[-1]
    assert (read_map(maps.folder, "position")[..., 3] == 1).all()


def test_instances_that_nodes_make_of_another_object(tmp_path):
    material = new_material()
    source = plane(material)
    source.hide_render = True
    bpy.ops.mesh.primitive_plane_add(size=2, location=(0, 0, 5))
    scattered = bpy.context.object

    def build(group, geometry):
        info = group.nodes.new("GeometryNodeObjectInfo")
        info.inputs["Object"].default_value = source
        on = group.nodes.new("GeometryNodeInstanceOnPoints")
        group.links.new(geometry, on.inputs["Points"])
        group.links.new(info.outputs["Geometry"], on.inputs["Instance"])
        return on.outputs[0]

    with_nodes(scattered, build)
    bpy.context.view_layer.update()
    position = maps_of(material, tmp_path)["position"]
    assert (position[..., 3] > 0).any()
    np.testing.assert_allclose(position[position[..., 3] > 0][:, 2], 5)


def test_tiles_lie_in_one_map_as_their_textures_do(tmp_path):
    material = new_material()
    _, second = plane(material), plane(material)
    second.location.x = 5
    for corner in second.data.uv_layers[0].data:
        corner.uv.x += 1
    maps = maps_of(material, tmp_path, used=((0, 0), (1, 0)))
    position = maps["position"]
    height, width = position.shape[:2]
    assert width == 2 * height
    np.testing.assert_allclose(position[:, :height, 0].mean(), 0, atol=1e-4)
    np.testing.assert_allclose(position[:, height:, 0].mean(), 5, atol=1e-4)


def test_islands_of_a_few_texels_keep_theirs(tmp_path):
    material = new_material()
    obj = cube(material)
    for corner in obj.data.uv_layers[0].data:
        corner.uv *= 0.02
    maps = maps_of(material, tmp_path)
    covered = maps["position"][..., 3] > 0
    assert 6 <= covered.sum() < 40
    places = maps["position"][covered][:, :3]
    assert np.abs(places).max() <= 1 + 1e-5
    np.testing.assert_allclose(np.abs(places).max(1), 1, atol=1e-5)
    there = maps["ao"][-8:, :8]
    assert there.max() > 0.5, "baked, or taken from what lies near"


# Nothing is changed, and what was made is used again


@pytest.mark.parametrize("make", [tiled, without_uvs, lambda material: [monkey(material)]])
def test_nothing_of_the_file_is_changed(tmp_path, make):
    material = new_material()
    make(material)
    before = everything()
    written(material, tmp_path)
    assert everything() == before


def test_maps_are_kept_while_the_meshes_have_not_changed(tmp_path):
    material = new_material()
    obj = plane(material)
    first = written(material, tmp_path, size=32).folder
    stamp = (first / "ao.exr").stat().st_mtime_ns
    assert written(material, tmp_path, size=32).folder == first
    assert (first / "ao.exr").stat().st_mtime_ns == stamp
    for i in range(6):
        obj.location.x = i + 1
        bpy.context.view_layer.update()
        assert written(material, tmp_path, size=32).folder != first
    assert len(list((tmp_path / "kept").iterdir())) == 4


def test_the_same_meshes_give_the_same_maps(tmp_path):
    material = new_material()
    monkey(material)
    first = maps_of(material, tmp_path / "a")
    second = maps_of(material, tmp_path / "b")
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name])
