"""A UV map of timing's own in a live material: looked up, shared, taken away by Revert."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import read, settled
from tests.blender.live_cases import made_up_live, write_image
from tests.blender.live_materials import emitting, shown
from tests.blender.material_cases import new_material, plane, principled_of, view_from_above
from tests.blender.surface_truth import everything, read_map, tiled, without_uvs, written
from tvbrdf.tvbrdf_addon.errors import MaterialError
from tvbrdf.tvbrdf_addon.material.binding.bind import bind
from tvbrdf.tvbrdf_addon.material.binding.freeze_live import freeze_live
from tvbrdf.tvbrdf_addon.material.nodes.revert import revert
from tvbrdf.tvbrdf_addon.material.surface_maps.maps import SurfaceMaps

pytestmark = pytest.mark.usefixtures("empty_scene")


def tiles(material: bpy.types.Material) -> list[bpy.types.Object]:
    """A plane of 2 x 2 in four objects, each of which has all of the UV map."""
    objects = []
    for x in (-0.5, 0.5):
        for y in (-0.5, 0.5):
            objects.append(plane(material))
            objects[-1].scale, objects[-1].location = (0.5, 0.5, 1), (x, y, 0)
    bpy.context.view_layer.update()
    return objects


def bound(material, obj, tmp_path: Path, late=lambda position: position[..., 0] > 0) -> SurfaceMaps:
    """Binds a live result that starts at once, but never where a place is `late`."""
    maps = written(material, tmp_path)
    assert maps.own is not None
    folder = made_up_live(tmp_path / "live", count=0)
    position = read_map(maps.folder, "position")
    onset = late(position).astype(np.float16)
    timing = np.stack((onset, 1 - onset, np.zeros_like(onset)), -1)
    write_image(folder / "timing.exr", timing)
    reading = read(material, obj, tmp_path)
    bind(
        material=material,
        reading=reading,
        folder=folder,
        frame_start=1,
        frame_end=11,
        uv_map=maps.own,
    )
    return maps


def gray(material) -> None:
    principled_of(material).inputs["Base Color"].default_value = (0.6, 0.6, 0.6, 1)


def test_places_that_share_texels_age_apart(tmp_path):
    """Four tiles of the same UVs make a plane: it ages to the left of x = 0, not to the right."""
    material = new_material()
    gray(material)
    objects = tiles(material)
    bound(material, objects[0], tmp_path)
    emitting(material)
    view_from_above()
    young, old = shown(tmp_path, 1, 16), shown(tmp_path, 11, 16)
    np.testing.assert_array_equal(young[:, 8:], old[:, 8:])
    assert np.abs(young[:, :8] - old[:, :8]).min() > 0.01


def test_within_one_mesh_too(tmp_path):
    material = new_material()
    gray(material)
    objects = tiled(material)
    bound(material, objects[0], tmp_path, late=lambda position: position[..., 1] > 0)
    emitting(material)
    view_from_above()
    young, old = shown(tmp_path, 1, 16), shown(tmp_path, 11, 16)
    np.testing.assert_array_equal(young[:7], old[:7])
    assert np.abs(young[9:] - old[9:]).min() > 0.01


@pytest.mark.parametrize("make", [tiles, tiled])
def test_revert_takes_the_map_away(tmp_path, make):
    material = new_material()
    objects = make(material)
    before, nodes = everything(), settled(material)
    bound(material, objects[0], tmp_path)
    assert all("Age" in obj.data.uv_layers for obj in objects)
    active = {obj.data.uv_layers.active.name for obj in objects}
    assert active == {"UVMap"}, "what is rendered and edited stays"
    revert(material)
    assert everything() == before
    assert settled(material) == nodes
    assert not any(mesh.keys() for mesh in bpy.data.meshes)


def test_where_there_was_none_the_next_run_makes_one_again(tmp_path):
    """Its own map, which a mesh without any then renders with, is not taken for the artist's."""
    material = new_material()
    obj = without_uvs(material)[0]
    before = everything()
    folder = made_up_live(tmp_path / "live", count=0)
    material.tvbrdf.onset = "none"  # so that reading asks for no UV map
    for _ in range(2):
        maps = written(material, tmp_path)
        assert maps.own is not None
        assert maps.own.name == "Age"
        bind(
            material=material,
            reading=read(material, obj, tmp_path),
            folder=folder,
            frame_start=1,
            frame_end=11,
            uv_map=maps.own,
        )
        assert [each.name for each in obj.data.uv_layers] == ["Age"]
    revert(material)
    assert everything() == before


def test_a_copy_of_the_material_keeps_the_map_that_it_uses(tmp_path):
    material = new_material()
    obj = tiles(material)[0]
    bound(material, obj, tmp_path)
    copy = material.copy()
    obj.material_slots[0].material = copy
    revert(material)
    assert "Age" in obj.data.uv_layers
    revert(copy)
    assert "Age" not in obj.data.uv_layers


def test_looking_at_an_aged_material_keeps_its_map(tmp_path):
    material = new_material()
    obj = tiles(material)[0]
    bound(material, obj, tmp_path)
    read(material, obj, tmp_path)
    assert "Age" in obj.data.uv_layers


def test_maps_of_two_materials_on_one_mesh(tmp_path):
    first, second = new_material(), new_material("Other")
    obj = tiled(first)[0]
    obj.data.materials.append(second)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide()
    bpy.ops.object.mode_set(mode="OBJECT")
    obj.data.polygons[0].material_index = 1
    bound(first, obj, tmp_path)
    maps = bound(second, obj, tmp_path)
    assert maps.own.name == "Age 2"
    revert(first)
    assert [each.name for each in obj.data.uv_layers] == ["UVMap", "Age 2"]
    revert(second)
    assert [each.name for each in obj.data.uv_layers] == ["UVMap"]


def test_a_mesh_that_was_changed_meanwhile_is_told(tmp_path):
    material = new_material()
    obj = tiled(material)[0]
    maps, reading = written(material, tmp_path), read(material, obj, tmp_path)
    folder = made_up_live(tmp_path / "live", count=0)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide()
    bpy.ops.object.mode_set(mode="OBJECT")
    before = settled(material)
    with pytest.raises(MaterialError, match="The mesh “Plane” was changed while"):
        bind(
            material=material,
            reading=reading,
            folder=folder,
            frame_start=1,
            frame_end=11,
            uv_map=maps.own,
        )
    assert settled(material) == before
    assert [each.name for each in obj.data.uv_layers] == ["UVMap"]


def test_frozen_it_keeps_its_nodes_and_its_age(tmp_path):
    material = new_material()
    gray(material)
    obj = tiles(material)[0]
    bound(material, obj, tmp_path)
    emitting(material)
    view_from_above()
    then = shown(tmp_path, 7)
    bpy.context.scene.frame_set(7)
    said = freeze_live(material, obj, bpy.context.scene)
    assert "keeps its nodes, with Age as it is" in said[0]
    np.testing.assert_allclose(shown(tmp_path, 11), then, atol=1e-6)
    revert(material)
    assert "Age" not in obj.data.uv_layers
