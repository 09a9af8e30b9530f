"""Where places share texels their timing has a UV map of its own: made, bound, taken away."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests.blender.material_cases import new_material
from tests.blender.object_cases import modified
from tests.blender.surface_truth import cube, errors, read_map, tiled, without_uvs, written

pytestmark = pytest.mark.usefixtures("empty_scene")


def uvs_of(obj: bpy.types.Object, maps) -> None:
    """Gives an object's mesh the map that was made for it, as binding does."""
    mesh = obj.data
    layer = mesh.uv_layers.new(name=maps.own.name, do_init=False)
    layer.data.foreach_set("uv", maps.own.places[mesh.session_uid].ravel())


def two_walls_of_the_same_uvs(material) -> list[bpy.types.Object]:
    return [cube(material), cube(material, location=(5, 0, 0))]


def mirrored_halves(material) -> list[bpy.types.Object]:
    obj = cube(material)
    for layer in obj.data.uv_layers:
        for face in obj.data.polygons:
            if face.normal.x < -0.5:
                other = next(each for each in obj.data.polygons if each.normal.x > 0.5)
                for a, b in zip(face.loop_indices, other.loop_indices, strict=True):
                    layer.data[a].uv = layer.data[b].uv
    return [obj]


def on_one_point(material) -> list[bpy.types.Object]:
    obj = cube(material)
    for corner in obj.data.uv_layers[0].data:
        corner.uv = (0.0, 0.0)
    return [obj]


def test_mirrored_halves_age_alike_where_the_artist_wants_it(tmp_path):
    material = new_material()
    mirrored_halves(material)
    apart, alike = (written(material, tmp_path, size=256, alike=each) for each in (False, True))
    assert apart.own is not None and alike.own is None
    assert any("alike, as Mirrored Alike says" in each for each in alike.notes)
    x = read_map(alike.folder, "position")[..., 0]
    covered = read_map(alike.folder, "position")[..., 3] > 0
    assert (x[covered] > 0.99).mean() + (x[covered] < -0.99).mean() < 0.3, (
        "one half stands for both"
    )


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (two_walls_of_the_same_uvs, "lie on one another in its UV map"),
        (mirrored_halves, "lie on one another in its UV map"),
        (tiled, "repeats its textures"),
        (without_uvs, "has no UV map with an area"),
        (on_one_point, "has no UV map with an area"),
    ],
)
def test_where_texels_are_shared_places_have_a_uv_map_of_their_own(tmp_path, make, why):
    material = new_material()
    objects = make(material)
    before = [[each.name for each in obj.data.uv_layers] for obj in objects]
    maps = written(material, tmp_path, size=256)
    assert maps.own is not None
    assert maps.own.name == "Age"
    assert why in maps.notes[0]
    assert "a UV map of its own, “Age”" in maps.notes[0]
    assert [[each.name for each in obj.data.uv_layers] for obj in objects] == before
    found = {"position": read_map(maps.folder, "position")}
    for obj in objects:
        uvs_of(obj, maps)
    for obj in objects:
        assert np.quantile(errors(found, obj, uv_map="Age"), 0.95) < 0.1


def test_a_material_that_is_not_laid_out_by_uvs(tmp_path):
    material = new_material()
    cube(material)
    maps = written(material, tmp_path, uv_map=None)
    assert maps.own is not None
    assert "is not laid out by a UV map" in maps.notes[0]


def test_linked_duplicates_share_the_map_made_for_their_mesh(tmp_path):
    material = new_material()
    first = tiled(material)[0]
    duplicate = first.copy()
    duplicate.location.x = 3
    bpy.context.scene.collection.objects.link(duplicate)
    maps = written(material, tmp_path)
    assert len(maps.own.places) == 1
    assert "1 linked duplicate or instances of “Plane”" in maps.notes[1]


def test_modifiers_keep_the_map_made_and_those_that_do_not_are_told(tmp_path):
    material = new_material()
    obj = tiled(material)[0]
    modified(obj, "SUBSURF", subdivision_type="SIMPLE", levels=2, render_levels=2)
    maps = written(material, tmp_path)
    found = {"position": read_map(maps.folder, "position")}
    uvs_of(obj, maps)
    bpy.context.view_layer.update()
    assert np.quantile(errors(found, obj, uv_map="Age"), 0.95) < 0.05
    modified(obj, "REMESH")
    maps = written(material, tmp_path)
    assert maps.folder is None
    assert "The modifiers of “Plane” leave no UV map" in maps.notes[-1]


def test_a_name_that_is_taken_is_not_used(tmp_path):
    material = new_material()
    obj = tiled(material)[0]
    obj.data.uv_layers.new(name="Age")
    assert written(material, tmp_path).own.name == "Age 2"


def test_a_mesh_without_room_for_another_map_is_left_alone(tmp_path):
    material = new_material()
    obj = tiled(material)[0]
    while len(obj.data.uv_layers) < 8:
        obj.data.uv_layers.new()
    maps = written(material, tmp_path)
    assert maps.folder is None
    assert "has as many UV maps as it can have" in maps.notes[0]


def test_text_has_a_way_out(tmp_path):
    material = new_material()
    bpy.ops.object.text_add()
    bpy.context.object.data.materials.append(material)
    maps = written(material, tmp_path)
    assert maps.folder is None
    assert "“Text” is no mesh" in maps.notes[0]
    assert "Object > Convert > Mesh" in maps.notes[0]


def test_a_plain_mesh_without_uvs_is_not_refused_where_a_map_is_made_for_it():
    from tvbrdf.tvbrdf_addon.material.reading.check import why_not

    material = new_material()
    obj = without_uvs(material)[0]
    assert why_not(material, obj) is None
    material.tvbrdf.binding = "frames"
    assert "has no UV map" in str(why_not(material, obj))
