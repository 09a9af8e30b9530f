"""The one Principled BSDF of a surface ages where it stands: behind mixers, in node groups."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import FORMATS, bind, read, settled
from tests.blender.material_cases import (
    add,
    add_sun,
    image,
    link,
    made_up,
    new_material,
    plane,
    principled_of,
    procedural,
    read_maps,
    render,
    view_from_above,
    write_result,
)
from tests.blender.surface_cases import (
    GROUPS,
    MIXERS,
    end_of,
    fill,
    in_a_group,
    in_a_group_used_twice,
    in_nested_groups,
    new_group,
    show_group,
    through_a_group,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("build", MIXERS + GROUPS)
def test_it_ages_and_comes_back(tmp_path, build: Callable, kind):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
    from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged, revert

    material = new_material()
    if build in MIXERS and build is not through_a_group:
        procedural(material)
    build(material)
    other = material.copy()
    obj = plane(material)
    before = settled(material)
    others = settled(other)
    bind(material, obj, made_up(tmp_path / "aged", kind), tmp_path)
    assert is_aged(material)
    seen = settled(other)
    seen["groups"] = {name: seen["groups"][name] for name in others["groups"]}
    for key in ("nodes", "links", "animation", "groups"):
        assert seen[key] == others[key], f"another material's {key} changed"
    bind(material, obj, made_up(tmp_path / "again", kind), tmp_path)
    freeze(material, 4)
    revert(material)
    after = settled(material)
    for key in before:
        assert after[key] == before[key], key


def textured_group() -> bpy.types.NodeTree:
    """A group that holds images, their mapping, and a Principled BSDF with a normal map."""
    group = new_group("Textured")
    start = next(node for node in group.nodes if node.type == "GROUP_INPUT")
    coordinates, mapping = (
        group.nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "Mapping")
    )
    mapping.inputs["Scale"].default_value = (3, 2, 1)
    group.links.new(coordinates.outputs["UV"], mapping.inputs["Vector"])
    shader, bump = (group.nodes.new(f"ShaderNode{kind}") for kind in ("BsdfPrincipled", "Bump"))
    texture = group.nodes.new("ShaderNodeTexImage")
    texture.image = image("Boards", np.random.default_rng(0).random((8, 4, 3)))
    group.links.new(mapping.outputs[0], texture.inputs["Vector"])
    group.links.new(texture.outputs[0], shader.inputs["Base Color"])
    group.links.new(start.outputs["Noise"], shader.inputs["Roughness"])
    group.links.new(texture.outputs[0], bump.inputs["Height"])
    group.links.new(bump.outputs[0], shader.inputs["Normal"])
    fill(group, shader.outputs[0])
    return group


def ungrouped(material) -> None:
    """The same nodes as `textured_group` makes, in the material itself, with Roughness 0.25."""
    tree, shader = material.node_tree, principled_of(material)
    coordinates, mapping = add(material, "ShaderNodeTexCoord"), add(material, "ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = (3, 2, 1)
    tree.links.new(coordinates.outputs["UV"], mapping.inputs["Vector"])
    texture = add(material, "ShaderNodeTexImage", image=bpy.data.images["Boards"])
    tree.links.new(mapping.outputs[0], texture.inputs["Vector"])
    link(material, texture.outputs[0], "Base Color")
    shader.inputs["Roughness"].default_value = 0.25
    bump = add(material, "ShaderNodeBump")
    tree.links.new(texture.outputs[0], bump.inputs["Height"])
    link(material, bump.outputs[0], "Normal")


@pytest.mark.parametrize("kind", FORMATS)
def test_a_group_looks_like_its_nodes_without_a_group(tmp_path, kind):
    rng = np.random.default_rng(1)
    names = {path.name.rpartition("_")[0] for path in made_up(tmp_path / "x", kind).glob("*.exr")}
    shapes = {
        name: (8, 4, 3) if name in ("kd", "ks") or "color" in name or "tint" in name else (8, 4)
        for name in names
    }
    maps = {
        name: [rng.uniform(0.2, 0.8, shape) for _ in range(3)] for name, shape in shapes.items()
    }
    folder = write_result(tmp_path / "aged", kind, maps)
    view_from_above()
    add_sun((0.3, 0.2, -1))
    pictures = []
    for grouped in (True, False):
        material = new_material()
        if grouped:
            node = show_group(material, textured_group())
            for link_in in list(node.inputs["Noise"].links):
                material.node_tree.links.remove(link_in)
            node.inputs["Noise"].default_value = 0.25
        else:
            ungrouped(material)
        obj = plane(material)
        reading = read(material, obj, tmp_path)
        assert not reading.uniform
        assert reading.uv_map is None, "the images keep their mapping"
        bind(material, obj, folder, tmp_path, span=(1, 5))
        pictures.append([render(tmp_path / "r.exr", frame, size=32) for frame in (1, 2, 5)])
        bpy.data.objects.remove(obj)
    np.testing.assert_allclose(pictures[0], pictures[1], rtol=1e-5, atol=1e-6)
    assert np.ptp(pictures[0][0]) > 0.05


def test_what_a_group_computes_is_read_as_without_a_group(tmp_path):
    """By the UV map where position matters: noise from outside, a ramp inside, a value inside."""
    from tvbrdf.tvbrdf_addon.material.reading.read import read as read_material

    maps = []
    for build in (in_a_group, in_nested_groups, None):
        material = new_material()
        if build is not None:
            build(material)
        else:
            noise, ramp = (add(material, f"ShaderNode{kind}") for kind in ("TexNoise", "ValToRGB"))
            material.node_tree.links.new(noise.outputs[0], ramp.inputs[0])
            link(material, ramp.outputs[0], "Base Color")
            for socket in ("Roughness", "Metallic"):
                link(material, noise.outputs[0], socket)
            principled_of(material).inputs["IOR"].default_value = 1.8
            principled_of(material).inputs["Specular Tint"].default_value = (0, 0, 0, 1)
        folder = tmp_path / f"maps {len(maps)}"
        folder.mkdir()
        groups = list(bpy.data.node_groups)
        read_material(
            material=material, obj=plane(material), scene=bpy.context.scene, folder=folder, size=32
        )
        assert list(bpy.data.node_groups) == groups
        maps.append(read_maps(folder))
    flat = maps.pop()
    assert np.ptp(flat["Roughness"]) > 0.1
    for grouped in maps:
        assert set(grouped) == set(flat)
        for name, values in flat.items():
            np.testing.assert_allclose(grouped[name], values, atol=1e-5, err_msg=name)


def second_principled(material) -> bpy.types.Node:
    """Mixes the material's Principled half and half with another, “Moss”; returns the mix."""
    tree, mix = material.node_tree, add(material, "ShaderNodeMixShader")
    moss = add(material, "ShaderNodeBsdfPrincipled", label="Moss")
    tree.links.new(principled_of(material).outputs[0], mix.inputs[1])
    tree.links.new(moss.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], end_of(material))
    return mix


@pytest.mark.parametrize(
    ("factor", "chosen", "ages"),
    [(0.5, "", ""), (0.6, "", "Moss"), (0.4, "", ""), (0.4, "Principled BSDF.001", "Moss")],
)
def test_of_two_that_are_mixed_the_larger_share_ages_or_the_chosen_one(
    tmp_path, factor: float, chosen: str, ages: str
):
    from tvbrdf.tvbrdf_addon.material.nodes.surface import find_principled

    material = new_material()
    second_principled(material).inputs["Fac"].default_value = factor
    material.tvbrdf.shader = chosen
    place = find_principled(material)
    assert place.principled.label == ages
    names = ("“Moss”", "“Principled BSDF”") if ages else ("“Principled BSDF”", "“Moss”")
    said = f"mixes, {names[0]} ages, while {names[1]} stays as made."
    obj = plane(material)
    assert [each for each in read(material, obj, tmp_path).warnings if each.endswith(said)]
    bind(material, obj, made_up(tmp_path / "aged", FORMATS[0]), tmp_path)
    aged, kept = (find_principled(material).principled, find_principled(material).beside)
    assert aged.label == ages
    assert aged.inputs["Base Color"].is_linked
    assert not kept[0].principled.inputs["Base Color"].is_linked


def test_which_one_ages_is_chosen_in_a_menu():
    from tvbrdf.tvbrdf_addon.material.nodes.surface import find_principled

    material = new_material()
    second_principled(material)
    plane(material)
    (moss,) = find_principled(material).beside
    assert bpy.ops.tvbrdf.choose_shader(path=moss.path) == {"FINISHED"}
    assert find_principled(material).name == "“Moss”"


def test_one_group_shown_twice_is_two_of_them():
    from tvbrdf.tvbrdf_addon.material.nodes.surface import find_principled

    material = new_material()
    in_a_group_used_twice(material)
    mix = next(node for node in material.node_tree.nodes if node.type == "MIX_SHADER")
    mix.inputs["Fac"].default_value = 0.5
    place = find_principled(material)
    names = {each.name.rpartition(" in ")[2] for each in (place, *place.beside)}
    assert names == {"“Group”", "“Group.001”"}


def test_a_muted_group_is_named_as_what_it_is():
    from tvbrdf.tvbrdf_addon.material.reading.check import why_not

    material = new_material("Metal")
    in_a_group(material)
    obj = plane(material)
    assert why_not(material, obj) is None
    group = next(node for node in material.node_tree.nodes if node.type == "GROUP")
    group.label, group.mute = "Paint", True
    said = why_not(material, obj)
    assert said == "“Paint”, which is the surface of “Metal”, is muted: unmute it."


@pytest.mark.parametrize("by", ["socket", "value node", "group input"])
@pytest.mark.parametrize(("factor", "shown"), [(0.0, "Principled BSDF"), (1.0, "Moss"), (0.2, "")])
def test_a_factor_that_never_changes_decides(factor: float, shown: str, by: str):
    from tvbrdf.tvbrdf_addon.material.nodes.surface import find_principled

    material = new_material()
    mix = second_principled(material)
    if by == "socket":
        mix.inputs["Fac"].default_value = factor
    else:
        value = add(material, "ShaderNodeValue")
        value.outputs[0].default_value = factor
        material.node_tree.links.new(value.outputs[0], mix.inputs["Fac"])
    if by == "group input":
        group = bpy.data.node_groups.new("Both", "ShaderNodeTree")
        group.interface.new_socket("Factor", in_out="INPUT", socket_type="NodeSocketFloat")
        group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
        inner = group.nodes.new("ShaderNodeMixShader")
        group.links.new(group.nodes.new("NodeGroupInput").outputs[0], inner.inputs["Fac"])
        for slot, label in ((1, ""), (2, "Moss")):
            shader = group.nodes.new("ShaderNodeBsdfPrincipled")
            shader.label = label
            group.links.new(shader.outputs[0], inner.inputs[slot])
        group.links.new(inner.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
        node = add(material, "ShaderNodeGroup")
        node.node_tree = group
        node.inputs[0].default_value = factor
        material.node_tree.links.new(node.outputs[0], end_of(material))
    place = find_principled(material)
    if shown:
        assert (place.principled.label or "Principled BSDF") == shown
    assert len(place.beside) == (0 if shown else 1)


def test_a_color_as_factor_decides_nothing():
    from tvbrdf.tvbrdf_addon.material.nodes.surface import find_principled

    material = new_material()
    mix = second_principled(material)
    group = bpy.data.node_groups.new("Color to Shader", "ShaderNodeTree")
    group.interface.new_socket("Factor", in_out="INPUT", socket_type="NodeSocketColor")
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    for side in ("A", "B"):
        group.interface.new_socket(side, in_out="INPUT", socket_type="NodeSocketShader")
    start, inner = group.nodes.new("NodeGroupInput"), group.nodes.new("ShaderNodeMixShader")
    for output, socket in zip(start.outputs[:3], inner.inputs, strict=True):
        group.links.new(output, socket)
    group.links.new(inner.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    node = add(material, "ShaderNodeGroup")
    node.node_tree = group
    for socket, theirs in zip(node.inputs[1:], mix.inputs[1:], strict=True):
        material.node_tree.links.new(theirs.links[0].from_socket, socket)
    material.node_tree.links.new(node.outputs[0], end_of(material))
    assert find_principled(material).beside


def test_a_keyed_factor_decides_nothing():
    from tvbrdf.tvbrdf_addon.material.nodes.surface import find_principled

    material = new_material()
    factor = second_principled(material).inputs["Fac"]
    factor.default_value = 0.0
    factor.keyframe_insert("default_value", frame=1)
    assert find_principled(material).beside


# A second Material Output


def outputs(material) -> tuple[bpy.types.Node, bpy.types.Node]:
    first = material.node_tree.get_output_node("CYCLES")
    second = add(material, "ShaderNodeOutputMaterial", target="EEVEE")
    first.target = "CYCLES"
    return first, second


@pytest.mark.parametrize("kind", FORMATS)
def test_an_output_for_eevee_that_shows_the_same_ages_too(tmp_path, kind):
    material = new_material()
    procedural(material)
    _, second = outputs(material)
    material.node_tree.links.new(principled_of(material).outputs[0], second.inputs["Surface"])
    obj = plane(material)
    assert not [said for said in read(material, obj, tmp_path).warnings if "EEVEE" in said]
    bind(material, obj, made_up(tmp_path / "aged", kind), tmp_path)
    first = material.node_tree.get_output_node("CYCLES").inputs["Surface"].links[0].from_socket
    assert second.inputs["Surface"].links[0].from_socket == first


def test_an_output_for_eevee_that_shows_something_else_is_said(tmp_path):
    material = new_material()
    _, second = outputs(material)
    tree = material.node_tree
    tree.links.new(add(material, "ShaderNodeBsdfDiffuse").outputs[0], second.inputs["Surface"])
    said = [each for each in read(material, plane(material), tmp_path).warnings if "EEVEE" in each]
    assert len(said) == 1
    assert second.name in said[0]


def test_a_material_for_eevee_alone_is_baked_and_aged(tmp_path):
    material = new_material()
    procedural(material)
    material.node_tree.get_output_node("CYCLES").target = "EEVEE"
    obj = plane(material)
    before = settled(material)
    read(material, obj, tmp_path)
    assert np.ptp(read_maps(tmp_path / "maps")["Roughness"]) > 0.1
    assert settled(material) == before
