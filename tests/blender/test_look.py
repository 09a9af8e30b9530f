"""The picture in the panel of where aging would start."""

from __future__ import annotations

import bpy
import pytest

from tests.blender.material_cases import new_material, plane

pytestmark = pytest.mark.usefixtures("empty_scene", "stub_worker")


@pytest.fixture
def material(tmp_path) -> bpy.types.Material:
    material = new_material()
    plane(material)
    material.tvbrdf.ntm, material.tvbrdf.output = "rust", str(tmp_path / "aged")
    return material


def test_a_look_changes_nothing_and_shows_pictures(material, tmp_path):
    from tvbrdf.tvbrdf_addon import look, session

    nodes = len(material.node_tree.nodes)
    assert bpy.ops.tvbrdf.look(material=material.name) == {"FINISHED"}
    shown = look._shown
    assert shown is not None and shown.material_uid == material.session_uid
    assert len(shown.pictures) == 2
    assert all(each.image_size[0] > 0 for each in shown.pictures.values())
    assert len(material.node_tree.nodes) == nodes
    assert not (tmp_path / "aged").exists()
    assert session.current() is None


def test_another_look_takes_the_place_of_the_first(material):
    from tvbrdf.tvbrdf_addon import look

    for seed in (0, 1):
        material.tvbrdf.seed = seed
        bpy.ops.tvbrdf.look(material=material.name)
        assert look._shown is not None and look._shown.asked["seed"] == seed


def test_without_a_surface_it_says_why(material):
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    with pytest.raises(RuntimeError, match="select an object"):
        bpy.ops.tvbrdf.look(material=material.name)
