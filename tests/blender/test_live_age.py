"""Which Age a live material shows: its own, its object's or instancer's, a copy's, a library's."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import settled
from tests.blender.live_materials import aged, emitting, flat, group_node, shown
from tests.blender.material_cases import plane, view_from_above
from tvbrdf.tvbrdf_addon.material.nodes.animation import channels
from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

pytestmark = pytest.mark.usefixtures("empty_scene")


def test_an_object_may_have_an_age_of_its_own(tmp_path):
    material, obj = aged(tmp_path, onset=False)
    emitting(material)
    view_from_above()
    young, old = shown(tmp_path, 1), shown(tmp_path, 11)
    assert np.abs(young - old).max() > 0.1
    obj["Age"] = 1.0
    obj.update_tag()
    np.testing.assert_array_equal(shown(tmp_path, 1), old)
    obj["Age"] = 0.0
    obj.update_tag()
    np.testing.assert_array_equal(shown(tmp_path, 11), young)
    del obj["Age"]
    obj.update_tag()
    np.testing.assert_array_equal(shown(tmp_path, 11), old)


def test_a_hundred_objects_at_a_hundred_ages(tmp_path):
    """One material on planes of ages 0 to 1: each looks as the material does at that age."""
    material, obj = aged(tmp_path, flat, onset=False, count=0, span=(0, 99))
    emitting(material)
    view_from_above()
    scene = bpy.context.scene
    truth = np.stack([shown(tmp_path, frame, 4)[0, 0] for frame in (0, 33, 66, 99)])
    obj.hide_render = True
    for i in range(100):
        each = bpy.data.objects.new(f"Tile {i}", obj.data)
        each.scale = (0.1, 0.1, 1)
        each.location = (-0.9 + 0.2 * (i % 10), 0.9 - 0.2 * (i // 10), 0)
        each["Age"] = i / 99
        scene.collection.objects.link(each)
    picture = shown(tmp_path, 0, 20)[::2, ::2].reshape(100, 3)
    np.testing.assert_allclose(picture[[0, 33, 66, 99]], truth, atol=2e-4)
    assert (np.diff(picture[1:].sum(1)) < 0).all()


def test_instances_have_their_instancers_age(tmp_path):
    material, obj = aged(tmp_path, flat, onset=False, count=0)
    emitting(material)
    view_from_above()
    old = shown(tmp_path, 11, 4)
    collection = bpy.data.collections.new("Instanced")
    collection.objects.link(obj)
    bpy.context.scene.collection.objects.unlink(obj)
    instancer = bpy.data.objects.new("Instancer", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
    instancer["Age"] = 1.0
    bpy.context.scene.collection.objects.link(instancer)
    np.testing.assert_allclose(shown(tmp_path, 1, 4), old, rtol=1e-6)


def test_changing_the_range_moves_the_keys(tmp_path):
    material, _ = aged(tmp_path, span=(1, 11))
    (curve,) = channels(material)
    curve.keyframe_points.insert(6, 0.9)  # the artist's ease
    material.tvbrdf.frame_start = 101
    material.tvbrdf.frame_end = 121
    (curve,) = channels(material)
    points = [tuple(point.co) for point in curve.keyframe_points]
    np.testing.assert_allclose(points, [(101, 0), (111, 0.9), (121, 1)], atol=1e-4)
    bpy.context.scene.frame_set(111)
    assert material["Age"] == pytest.approx(0.9)


def test_so_does_the_scenes_range_unless_somebody_moved_them(tmp_path):
    from tvbrdf.tvbrdf_addon.follow import follow

    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 11
    material, _ = aged(tmp_path, span=(1, 11))
    scene.frame_end = 51
    follow()
    (curve,) = channels(material)
    assert [point.co.x for point in curve.keyframe_points] == [1, 51]
    curve.keyframe_points[1].co.x = 40
    scene.frame_end = 61
    follow()
    assert [point.co.x for point in curve.keyframe_points] == [1, 40]


def test_a_copy_has_its_own_age(tmp_path):
    material, _ = aged(tmp_path)
    copy = material.copy()
    (driver,) = copy.node_tree.animation_data.drivers
    assert driver.driver.variables[0].targets[0].id == copy
    before = settled(material)
    copy.tvbrdf.frame_end = 500
    assert settled(material)["nodes"] == before["nodes"]
    assert [point.co.x for point in channels(material)[0].keyframe_points] == [1, 11]
    revert(copy)
    assert settled(material) == before
    assert group_node(material).node_tree is not None


@pytest.mark.parametrize("link_it", [False, True])
def test_appended_and_linked_it_ages_on(tmp_path, link_it):
    material, _ = aged(tmp_path, flat, onset=False, count=0)
    emitting(material)
    view_from_above()
    pictures = [shown(tmp_path, frame, 4) for frame in (1, 6, 11)]
    path = tmp_path / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(path), link=link_it) as (_, wanted):
        wanted.materials = [material_name := "Paint"]
    plane(bpy.data.materials[material_name])
    view_from_above()
    bpy.context.scene.view_settings.view_transform = "Raw"
    for frame, picture in zip((1, 6, 11), pictures, strict=True):
        np.testing.assert_array_equal(shown(tmp_path, frame, 4), picture)


def test_a_library_override_may_have_another_age(tmp_path):
    aged(tmp_path, flat, onset=False, count=0)
    path = tmp_path / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        wanted.materials = ["Paint"]
    override = bpy.data.materials["Paint"].override_create()
    override["Age"] = 0.5
    paths = {each.rna_path for each in override.override_library.properties}
    override.override_library.operations_update()
    paths = {each.rna_path for each in override.override_library.properties}
    assert '["Age"]' in paths
