"""Aged materials that are linked, appended, copied, undone: each stays or reverts on its own."""

from __future__ import annotations

import bpy
import pytest

from tests.blender.aged_cases import bind, sentence, settled
from tests.blender.live_cases import made_up_live
from tests.blender.material_cases import add, awkward, made_up, new_material, plane
from tests.blender.surface_cases import in_nested_groups, show_group
from tests.blender.test_damage import aged

pytestmark = pytest.mark.usefixtures("empty_scene")


@pytest.mark.parametrize("override", [False, True])
def test_a_linked_material_is_left_to_its_own_file(tmp_path, override):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
    from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged, revert

    aged(tmp_path)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, to):
        to.materials = ["Paint"]
    (material,) = to.materials
    if override:
        material = material.override_create()
    assert is_aged(material)
    for operate in (revert, lambda m: freeze(m, 3)):
        assert "linked from another file" in sentence(lambda operate=operate: operate(material))
    assert bpy.ops.tvbrdf.revert.poll()
    with pytest.raises(RuntimeError, match="linked"):
        bpy.ops.tvbrdf.revert(material="Paint")
    with pytest.raises(RuntimeError, match="linked"):
        bpy.ops.tvbrdf.freeze(material="Paint")


@pytest.mark.parametrize("build", [awkward, in_nested_groups])
def test_a_material_made_local_leaves_what_is_linked_alone(tmp_path, build):
    """Only the material: its images, its action and its groups are the other file's still."""
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    _, before, _ = aged(tmp_path, build)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, to):
        to.materials = ["Paint"]
    material = to.materials[0].make_local()
    linked = {each for each in bpy.data.images if each.library}
    assert linked
    shown = {(each.name, each.source, each.filepath) for each in linked}
    copy = material.copy()
    freeze(copy, 4)
    assert {(each.name, each.source, each.filepath) for each in linked} == shown
    for each in (copy, material):
        revert(each)
        after = settled(each)
        assert after["links"] == before["links"]
        assert [n["inputs"] for n in after["nodes"]] == [n["inputs"] for n in before["nodes"]]


@pytest.mark.parametrize("build", [awkward, in_nested_groups])
def test_an_appended_material_reverts_exactly(tmp_path, build):
    """Into a file that has other data-blocks of the same names."""
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    other = new_material("Other")
    build(other)
    other.node_tree.copy()
    material, before, _ = aged(tmp_path, build)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    resident = new_material("Paint")
    build(resident)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=False) as (_, to):
        to.materials = ["Paint"]
    (material,) = to.materials
    kept = settled(resident)
    revert(material)
    after = settled(material)
    assert after["links"] == before["links"]
    assert [n["inputs"] for n in after["nodes"]] == [n["inputs"] for n in before["nodes"]]
    assert after["animation"]["curves"] == before["animation"]["curves"]
    now = settled(resident)
    assert {k: now[k] for k in ("nodes", "links", "animation")} == {
        k: kept[k] for k in ("nodes", "links", "animation")
    }


def test_nodes_pasted_from_an_aged_material_stay(tmp_path):
    from tvbrdf.tvbrdf_addon.material.nodes.ownership import TAG
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material = new_material()
    awkward(material)
    pasted = add(material, "ShaderNodeValue")
    pasted[TAG] = 1
    obj = plane(material)
    names = [node.name for node in material.node_tree.nodes]
    bind(material, obj, made_up(tmp_path / "aged"), tmp_path)
    revert(material)
    assert [node.name for node in material.node_tree.nodes] == names


def test_a_damaged_record_is_spoken_of_by_the_name_of_its_material(tmp_path):
    material, _, obj = aged(tmp_path)
    material.tvbrdf.original = material.tvbrdf.original.replace("Color", "Colour")
    said = sentence(lambda: bind(material, obj, made_up(tmp_path / "again"), tmp_path))
    assert "“Paint”" in said


def test_a_group_of_a_library_is_copied_and_comes_back(tmp_path):
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    in_nested_groups(new_material())
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, to):
        to.node_groups = ["Outer"]
    material = new_material()
    show_group(material, to.node_groups[0])
    obj = plane(material)
    before = settled(material)
    bind(material, obj, made_up(tmp_path / "aged"), tmp_path)
    revert(material)
    after = settled(material)
    for key in before:
        assert after[key] == before[key], key


@pytest.mark.parametrize("build", [awkward, in_nested_groups])
@pytest.mark.parametrize("kind", ["principled", "torrance-sparrow"])
def test_every_copy_reverts_exactly_in_any_order(tmp_path, build, kind):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material, before, _ = aged(tmp_path, build, kind)
    copies = [material, material.copy(), material.copy()]
    freeze(copies[1], 5)
    copies.append(copies[1].copy())
    copies[2].name = "Renamed"
    for each in (copies[1], copies[0], copies[3], copies[2]):
        revert(each)
        after = settled(each)
        for key in ("nodes", "links"):
            assert after[key] == before[key], key
        curves = (after["animation"] or {}).get("curves")
        assert curves == (before["animation"] or {}).get("curves")
    after = settled(material)
    assert after["groups"] == before["groups"]
    assert after["images"] == before["images"]


@pytest.mark.parametrize("build", [awkward, in_nested_groups])
def test_undo_and_redo_take_and_give_the_whole_aging(tmp_path, build):
    from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged, revert

    material = new_material()
    build(material)
    obj = plane(material)
    before = settled(material)
    bpy.ops.ed.undo_push(message="made")
    bpy.ops.ed.undo_push(message="before")
    bind(material, obj, made_up(tmp_path / "aged"), tmp_path)
    bpy.ops.ed.undo_push(message="aged")
    revert(bpy.data.materials["Paint"])
    bpy.ops.ed.undo_push(message="reverted")
    bpy.ops.ed.undo()
    assert is_aged(bpy.data.materials["Paint"])
    bpy.ops.ed.undo()
    assert settled(bpy.data.materials["Paint"]) == before
    bpy.ops.ed.redo()
    assert is_aged(bpy.data.materials["Paint"])
    revert(bpy.data.materials["Paint"])
    after = settled(bpy.data.materials["Paint"])
    for key in before:
        assert after[key] == before[key], key


def test_what_a_copied_material_shows_of_a_group_comes_back_one_by_one(tmp_path):
    """Both show one copy of the artist's group, which the second still needs."""
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    def shown(material: bpy.types.Material) -> list[str]:
        return [socket.identifier for socket in material.node_tree.nodes["Group"].inputs]

    material = new_material()
    in_nested_groups(material)
    before = settled(material)
    bind(material, plane(material), made_up_live(tmp_path / "live", "principled"), tmp_path)
    copy = material.copy()
    while_aged = shown(copy)
    revert(material)
    assert settled(material)["nodes"] == before["nodes"]
    assert shown(copy) == while_aged
    revert(copy)
    assert settled(copy)["nodes"] == before["nodes"]
    assert sorted(group.name for group in bpy.data.node_groups) == ["Inner", "Outer"]
