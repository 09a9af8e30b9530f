"""What an artist, another program or a full disk does to an aged material: never half undone."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.blender.aged_cases import FORMATS, bind, emitting, sentence, settled
from tests.blender.material_cases import (
    add,
    awkward,
    made_up,
    new_material,
    plane,
    procedural,
    render,
    view_from_above,
)
from tests.blender.surface_cases import in_nested_groups

pytestmark = pytest.mark.usefixtures("empty_scene")
SHARED = settings(
    deadline=None, max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def aged(tmp_path: Path, build: Callable = awkward, kind: str = "principled"):
    """An aged material, what it was before, and its object."""
    material = new_material()
    build(material)
    obj = plane(material)
    before = settled(material)
    bind(material, obj, made_up(tmp_path / "aged", kind), tmp_path)
    return material, before, obj


# The record

JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from(["Principled BSDF", "Value", "Roughness", "GGX", "Color"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=4,
)


def _places(data: object, path: tuple = ()) -> list[tuple]:
    items = data.items() if isinstance(data, dict) else enumerate(data)
    inner = [(*path, key) for key, _ in items]
    nested = [key for key in inner if isinstance(_at(data, key[len(path) :]), (dict, list))]
    deeper = [p for key in nested for p in _places(_at(data, key[len(path) :]), key)]
    return inner + deeper


def _at(data, path: tuple):
    for key in path:
        data = data[key]
    return data


@pytest.mark.parametrize("summed", [False, True], ids=["as it is", "with a check sum that fits"])
def test_a_damaged_record_leaves_the_material_alone(tmp_path, summed):
    """Any field of any other value, or absent: a sentence, or a revert that raises nothing."""
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
    from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged, revert

    material, before, _ = aged(tmp_path, kind="torrance-sparrow")
    whole = json.loads(material.tvbrdf.original)

    @SHARED
    @given(data=st.data())
    def damaged(data) -> None:
        spoilt = json.loads(json.dumps(whole))
        *path, last = data.draw(st.sampled_from(_places(whole)))
        if data.draw(st.booleans()):
            _at(spoilt, tuple(path))[last] = data.draw(JSON)
        else:
            del _at(spoilt, tuple(path))[last]
        if spoilt == whole:
            return
        body = {k: v for k, v in spoilt.items() if k not in ("version", "sum")}
        if summed and spoilt.get("version") == whole["version"]:
            spoilt["sum"] = zlib.crc32(json.dumps(body).encode())
        copy = material.copy()
        try:
            copy.tvbrdf.original = json.dumps(spoilt)
            said = sentence(lambda: revert(copy))
            assert bool(said) == is_aged(copy)
            if not summed:
                assert "before aging" in said
                assert "before aging" in sentence(lambda: freeze(copy, 3))
        finally:
            bpy.data.materials.remove(copy)

    damaged()
    revert(material)
    assert settled(material)["nodes"] == before["nodes"]


def test_a_record_of_version_0_1_which_has_no_check_sum_is_understood(tmp_path):
    from tvbrdf.tvbrdf_addon.material.nodes.record import forget_names
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material, before, _ = aged(tmp_path)
    data = json.loads(material.tvbrdf.original)
    del data["sum"]
    material.tvbrdf.original = json.dumps({**data, "version": 1})
    forget_names(material.node_tree)
    revert(material)
    assert settled(material) == before


@pytest.mark.parametrize("text", ["[]", "{}", "7", "[" * 100_000, '{"version": 2}', '"x"', "\\"])
def test_so_does_text_that_is_no_record(tmp_path, text):
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material = new_material()
    material.tvbrdf.original = text
    assert "before aging" in sentence(lambda: revert(material))


# The nodes


def rename_all(material) -> None:
    for i, node in enumerate(list(material.node_tree.nodes)):
        node.name = f"Knoten {i} “ä”"


def relabel_all(material) -> None:
    for node in material.node_tree.nodes:
        node.label = ""


@pytest.mark.parametrize("frozen", [False, True])
@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("change", [rename_all, relabel_all])
def test_renamed_and_relabeled_nodes_are_found_again(tmp_path, change, kind, frozen):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material, before, _ = aged(tmp_path, kind=kind)
    change(material)
    if frozen:
        freeze(material, 4)
    revert(material)
    after = settled(material)
    names = dict(
        zip((n["name"] for n in after["nodes"]), (n["name"] for n in before["nodes"]), strict=True)
    )
    links = [(names[a], b, names[c], d, muted) for a, b, c, d, muted in after["links"]]
    assert links == before["links"]
    for now, then in zip(after["nodes"], before["nodes"], strict=True):
        assert now["inputs"] == then["inputs"]
        assert now["keys"] == then["keys"]


def delete_age(material) -> None:
    del material["Age"]


def delete_ours(material) -> None:
    from tvbrdf.tvbrdf_addon.material.nodes.record import tagged

    for node in tagged(material.node_tree)[::2]:
        material.node_tree.nodes.remove(node)


def delete_images(material) -> None:
    for each in list(bpy.data.images):
        bpy.data.images.remove(each)


def delete_actions(material) -> None:
    for each in list(bpy.data.actions):
        bpy.data.actions.remove(each)


def delete_drivers(material) -> None:
    drivers = material.node_tree.animation_data.drivers
    for each in list(drivers):
        drivers.remove(each)


def edit_drivers(material) -> None:
    for each in material.node_tree.animation_data.drivers:
        each.driver.expression = "nothing *"
        each.driver.variables.remove(each.driver.variables[0]) if each.driver.variables else None


def delete_principled(material) -> None:
    for node in list(material.node_tree.nodes):
        if node.type == "BSDF_PRINCIPLED":
            material.node_tree.nodes.remove(node)


def delete_all(material) -> None:
    material.node_tree.nodes.clear()


def delete_output(material) -> None:
    material.node_tree.nodes.remove(material.node_tree.get_output_node("ALL"))


def clear_animation(material) -> None:
    material.node_tree.animation_data_clear()


def other_kinds_of_fade(material) -> None:
    for node in material.node_tree.nodes:
        if node.type == "MIX":
            node.data_type = "VECTOR"


def relink(material) -> None:
    noise = add(material, "ShaderNodeTexVoronoi")
    for node in list(material.node_tree.nodes):
        for socket in node.inputs:
            if socket.type in ("VALUE", "RGBA") and socket.is_linked:
                material.node_tree.links.new(noise.outputs[0], socket)


def delete_groups(material) -> None:
    for each in list(bpy.data.node_groups):
        bpy.data.node_groups.remove(each)


def empty_groups(material) -> None:
    for each in bpy.data.node_groups:
        each.nodes.clear()
        each.interface.clear()


def single_user_groups(material) -> None:
    for node in material.node_tree.nodes:
        if node.type == "GROUP" and node.node_tree:
            node.node_tree = node.node_tree.copy()


EDITS = (
    *(delete_age, delete_ours, delete_images, delete_actions, delete_drivers, edit_drivers),
    *(delete_principled, delete_all, delete_output, clear_animation, other_kinds_of_fade, relink),
    *(rename_all, relabel_all, delete_groups, empty_groups, single_user_groups),
)


@pytest.mark.parametrize("build", [awkward, in_nested_groups])
@pytest.mark.parametrize("kind", ["principled", "torrance-sparrow"])
@pytest.mark.parametrize("edit", EDITS)
def test_whatever_the_artist_edits_a_sentence_or_the_deed(tmp_path, edit, kind, build):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
    from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged, revert

    material, _, obj = aged(tmp_path, build, kind)
    edit(material)
    copy = material.copy()
    obj.data.materials.append(copy)
    assert not sentence(lambda: freeze(material, 4))
    said = sentence(lambda: revert(material))
    assert bool(said) == is_aged(material)
    sentence(lambda: bind(copy, obj, made_up(tmp_path / "again", kind), tmp_path))


def test_nodes_of_ours_that_were_grouped_are_to_be_ungrouped(tmp_path):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
    from tvbrdf.tvbrdf_addon.material.nodes.ownership import TAG
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material, _, _ = aged(tmp_path)
    node = add(material, "ShaderNodeGroup", label="Mine")
    node.node_tree = bpy.data.node_groups.new("Mine", "ShaderNodeTree")
    node.node_tree.nodes.new("ShaderNodeMix")[TAG] = 1
    for operate in (revert, lambda m: freeze(m, 3)):
        said = sentence(lambda operate=operate: operate(material))
        assert "in the group “Mine”" in said
    material.node_tree.nodes.remove(node)
    revert(material)


@SHARED
@given(order=st.lists(st.sampled_from(EDITS), min_size=2, max_size=4), frozen=st.booleans())
def test_so_in_any_order(tmp_path, order, frozen):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
    from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged, revert

    bpy.ops.wm.read_factory_settings(use_empty=True)
    material, _, _ = aged(tmp_path, in_nested_groups if len(order) % 2 else awkward)
    for edit in order:
        if material.node_tree.animation_data is None and "drivers" in edit.__name__:
            continue
        if edit is delete_age and "Age" not in material:
            continue
        if edit is delete_output and material.node_tree.get_output_node("ALL") is None:
            continue
        edit(material)
        if frozen:
            sentence(lambda: freeze(material, 2))
    said = sentence(lambda: revert(material))
    assert bool(said) == is_aged(material)


@pytest.mark.parametrize("frame", [1, 6, 99])
def test_freezing_without_age_keeps_what_is_shown_and_the_artists_keys(tmp_path, frame):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
    from tvbrdf.tvbrdf_addon.material.nodes.animation import channels

    material, before, _ = aged(tmp_path)
    view_from_above()
    bpy.context.scene.frame_set(frame)
    delete_age(material)
    emitting(material)
    shown = render(tmp_path / "before.exr", frame, size=4, samples=1)
    freeze(material, frame)
    frozen = render(tmp_path / "after.exr", frame, size=4, samples=1)
    np.testing.assert_allclose(frozen, shown, rtol=2e-3)
    kept = {c.data_path for c in channels(material.node_tree)}
    assert kept == {path for path, *_ in before["animation"]["curves"]}


def test_freezing_a_relabeled_age_is_freezing(tmp_path):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze

    images = []
    for change in (relabel_all, rename_all, lambda _: None):
        material, _, _ = aged(tmp_path, procedural)
        change(material)
        freeze(material, 10)
        images.append(
            sorted(
                Path(n.image.filepath).name
                for n in material.node_tree.nodes
                if n.type == "TEX_IMAGE"
            )
        )
    assert images[0] == images[1] == images[2]
    assert "base_color_0004.exr" in images[0]


def test_freezing_with_a_texture_gone_from_the_disk_says_which(tmp_path):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze

    material, _, _ = aged(tmp_path)
    (tmp_path / "aged" / "roughness_0004.exr").unlink()
    assert "roughness_0004.exr is missing" in sentence(lambda: freeze(material, 10))
    assert not sentence(lambda: freeze(material, 1))
