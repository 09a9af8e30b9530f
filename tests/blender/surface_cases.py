"""Materials whose Principled BSDF stands behind mixers and in node groups."""

from __future__ import annotations

import bpy

from tests.blender.material_cases import add, principled_of, procedural


def end_of(material) -> bpy.types.NodeSocket:
    return material.node_tree.get_output_node("CYCLES").inputs["Surface"]


def mix_with_transparent(material) -> None:
    tree, mix = material.node_tree, add(material, "ShaderNodeMixShader")
    tree.links.new(add(material, "ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
    tree.links.new(principled_of(material).outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], end_of(material))


def add_emission(material) -> None:
    tree, both = material.node_tree, add(material, "ShaderNodeAddShader")
    tree.links.new(principled_of(material).outputs[0], both.inputs[0])
    tree.links.new(add(material, "ShaderNodeEmission").outputs[0], both.inputs[1])
    tree.links.new(both.outputs[0], end_of(material))


def nested_mixers(material) -> None:
    """A Principled that reaches both sides of a mix, by a reroute and past a muted mixer."""
    tree = material.node_tree
    reroute = add(material, "NodeReroute")
    tree.links.new(principled_of(material).outputs[0], reroute.inputs[0])
    both, mix = add(material, "ShaderNodeAddShader"), add(material, "ShaderNodeMixShader")
    tree.links.new(reroute.outputs[0], both.inputs[0])
    tree.links.new(add(material, "ShaderNodeBsdfSheen").outputs[0], both.inputs[1])
    muted = add(material, "ShaderNodeMixShader", mute=True)
    tree.links.new(both.outputs[0], muted.inputs[1])
    tree.links.new(muted.outputs[0], mix.inputs[1])
    tree.links.new(principled_of(material).outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], end_of(material))


def hidden_second(material) -> None:
    """A mix whose constant factor never shows its second Principled."""
    tree, mix = material.node_tree, add(material, "ShaderNodeMixShader")
    mix.inputs["Fac"].default_value = 0.0
    tree.links.new(principled_of(material).outputs[0], mix.inputs[1])
    tree.links.new(add(material, "ShaderNodeBsdfPrincipled").outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], end_of(material))


def mixed_by_a_texture(material) -> None:
    """A mix with a second Principled, which a texture tells apart: the first of them ages."""
    tree, mix = material.node_tree, add(material, "ShaderNodeMixShader")
    tree.links.new(add(material, "ShaderNodeTexNoise").outputs[0], mix.inputs["Fac"])
    tree.links.new(principled_of(material).outputs[0], mix.inputs[1])
    tree.links.new(add(material, "ShaderNodeBsdfPrincipled").outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], end_of(material))


def new_group(name: str = "Paint Group") -> bpy.types.NodeTree:
    group = bpy.data.node_groups.new(name, "ShaderNodeTree")
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    panel = group.interface.new_panel("Settings")
    group.interface.new_socket("Noise", in_out="INPUT", socket_type="NodeSocketFloat")
    group.interface.new_socket("Tint", in_out="INPUT", socket_type="NodeSocketColor", parent=panel)
    group.nodes.new("NodeGroupInput")
    group.nodes.new("NodeGroupOutput")
    return group


def fill(group: bpy.types.NodeTree, shader: bpy.types.NodeSocket) -> None:
    end = next(node for node in group.nodes if node.type == "GROUP_OUTPUT")
    group.links.new(shader, end.inputs[0])


def principled_group(name: str = "Paint Group") -> bpy.types.NodeTree:
    """Base Color, Roughness and Metallic by noise from outside, Specular Tint by a value."""
    group = new_group(name)
    start = next(node for node in group.nodes if node.type == "GROUP_INPUT")
    shader = group.nodes.new("ShaderNodeBsdfPrincipled")
    shader.parent = group.nodes.new("NodeFrame")
    ramp = group.nodes.new("ShaderNodeValToRGB")
    group.links.new(start.outputs["Noise"], ramp.inputs[0])
    group.links.new(ramp.outputs[0], shader.inputs["Base Color"])
    group.links.new(start.outputs["Noise"], shader.inputs["Roughness"])
    group.links.new(start.outputs["Noise"], shader.inputs["Metallic"])
    group.links.new(start.outputs["Tint"], shader.inputs["Specular Tint"])
    shader.inputs["IOR"].default_value = 1.8
    shader.inputs["IOR"].keyframe_insert("default_value", frame=1)
    shader.inputs["Emission Strength"].default_value = 0.25
    fill(group, shader.outputs[0])
    return group


def show_group(material, group: bpy.types.NodeTree) -> bpy.types.Node:
    """Shows `group` on the material, its Noise a noise, its Tint keyed."""
    tree = material.node_tree
    for node in [each for each in tree.nodes if each.type == "BSDF_PRINCIPLED"]:
        tree.nodes.remove(node)
    node = add(material, "ShaderNodeGroup")
    node.node_tree = group
    noise = add(material, "ShaderNodeTexNoise")
    tree.links.new(noise.outputs[0], node.inputs["Noise"])
    node.inputs["Tint"].keyframe_insert("default_value", frame=1)
    tree.links.new(node.outputs[0], end_of(material))
    return node


def in_a_group(material) -> None:
    show_group(material, principled_group())


def in_nested_groups(material) -> None:
    """A group in a group, of which both sides of a mix have one."""
    outer = new_group("Outer")
    inner = outer.nodes.new("ShaderNodeGroup")
    inner.node_tree = principled_group("Inner")
    start = next(node for node in outer.nodes if node.type == "GROUP_INPUT")
    outer.links.new(start.outputs["Noise"], inner.inputs["Noise"])
    mix = outer.nodes.new("ShaderNodeMixShader")
    outer.links.new(inner.outputs[0], mix.inputs[1])
    outer.links.new(outer.nodes.new("ShaderNodeBsdfTranslucent").outputs[0], mix.inputs[2])
    fill(outer, mix.outputs[0])
    show_group(material, outer)


def in_a_group_used_twice(material) -> None:
    """Two nodes of a group, of which the mix shows one."""
    first = show_group(material, principled_group())
    tree, mix = material.node_tree, add(material, "ShaderNodeMixShader")
    second = add(material, "ShaderNodeGroup")
    second.node_tree = first.node_tree
    mix.inputs["Fac"].default_value = 1.0
    tree.links.new(second.outputs[0], mix.inputs[1])
    tree.links.new(first.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], end_of(material))


def through_a_group(material) -> None:
    """The Principled stands outside; a group mixes something with the shader that it is given."""
    procedural(material)
    group = bpy.data.node_groups.new("Mixer", "ShaderNodeTree")
    for side in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Shader", in_out=side, socket_type="NodeSocketShader")
    both = group.nodes.new("ShaderNodeAddShader")
    group.links.new(group.nodes.new("NodeGroupInput").outputs[0], both.inputs[0])
    group.links.new(group.nodes.new("ShaderNodeEmission").outputs[0], both.inputs[1])
    group.links.new(both.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    node = add(material, "ShaderNodeGroup")
    node.node_tree = group
    tree = material.node_tree
    tree.links.new(principled_of(material).outputs[0], node.inputs[0])
    tree.links.new(node.outputs[0], end_of(material))


MIXERS = (
    *(mix_with_transparent, add_emission, nested_mixers),
    *(hidden_second, mixed_by_a_texture, through_a_group),
)
GROUPS = (in_a_group, in_nested_groups, in_a_group_used_twice)
