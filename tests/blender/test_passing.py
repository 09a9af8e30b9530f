"""What is made in passing leaves the file, without Blender looking through all of it each time."""

from __future__ import annotations

import bpy
import pytest

from tests.blender.material_cases import new_material, plane
from tvbrdf.tvbrdf_addon.material.reading.evaluated import evaluated
from tvbrdf.tvbrdf_addon.material.reading.passing import discard, one_stage, passing, stage

pytestmark = pytest.mark.usefixtures("empty_scene")


def blocks() -> set[str]:
    """Everything in the file; whatever points to something that is gone would show here."""
    return {f"{block.id_type} {block.name} {block.users}" for block in bpy.data.user_map()}


def test_what_nothing_uses_goes_and_what_something_uses_goes_from_there():
    material = new_material("Paint")
    before = blocks()
    image = bpy.data.images.new("scratch", 4, 4)
    shown = bpy.data.images.new("shown", 4, 4)
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = shown
    discard(material.copy(), image, shown)
    assert blocks() == before
    assert node.image is None


def test_a_look_leaves_nothing_behind():
    obj = plane(new_material("Paint"))
    before = blocks()
    with evaluated(obj, 1) as look:
        assert len(look.mesh.vertices) == 4
    assert blocks() == before


def test_looks_share_a_stage_where_they_are_asked_to():
    objects = [plane(new_material(name)) for name in "AB"]
    objects[1].location.x = 3.0
    before = blocks()
    with one_stage():
        for obj in (*objects, *objects):
            with evaluated(obj, 1) as look:
                assert look.basis.translation.x == obj.location.x
                assert [slot.name for slot in look.mesh.materials] == [
                    obj.material_slots[0].material.name
                ]
            assert len(bpy.data.scenes) == 2
            assert blocks() - before == {"SCENE tvbrdf look 1"}
        with evaluated(objects[0], 1), evaluated(objects[1], 1):
            assert len(bpy.data.scenes) == 3
    assert blocks() == before


def test_it_leaves_the_artists_objects_where_they_are():
    obj = plane(new_material("Paint"))
    before = blocks()
    with one_stage():
        with passing() as made:
            stage("tvbrdf look", [obj], made).frame_set(3)
        with passing() as made:
            assert not stage("tvbrdf look", [], made).objects
    assert blocks() == before
    assert bpy.context.scene.objects[obj.name] == obj


def test_what_fails_leaves_nothing_behind():
    obj = plane(new_material("Paint"))
    before = blocks()
    with pytest.raises(ZeroDivisionError), one_stage(), evaluated(obj, 1):
        raise ZeroDivisionError
    assert blocks() == before
