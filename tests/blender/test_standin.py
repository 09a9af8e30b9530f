"""What stands in for the artist's object and scene in a bake: what materials ask of these, and
patterns and noise that one sample a texel does not catch."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import read
from tests.blender.material_cases import (
    add,
    image,
    link,
    new_material,
    plane,
    principled_of,
    read_maps,
    render,
    view_from_above,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


def color_of(material, obj, tmp_path) -> np.ndarray:
    read(material, obj, tmp_path)
    return read_maps(tmp_path / "maps")["BaseColor"]


def seen_as_light(material: bpy.types.Material, source: bpy.types.NodeSocket, file) -> np.ndarray:
    """What Cycles shows of `source` on the material's object."""
    tree = material.node_tree
    emission, output = add(material, "ShaderNodeEmission"), tree.get_output_node("CYCLES")
    tree.links.new(source, emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    view_from_above()
    return render(file, size=16)


def test_the_random_number_of_an_object(tmp_path):
    material = new_material()
    node = add(material, "ShaderNodeObjectInfo")
    link(material, node.outputs["Random"], "Base Color")
    obj = plane(material)
    names = [each.name for each in bpy.data.objects]
    found = color_of(material, obj, tmp_path)
    assert [each.name for each in bpy.data.objects] == names
    shown = seen_as_light(material, node.outputs["Random"], tmp_path / "r.exr")
    np.testing.assert_allclose(found[8, 8], shown[8, 8], atol=1e-3)


def test_the_color_the_index_and_a_property_of_an_object(tmp_path):
    material = new_material()
    obj = plane(material)
    obj.color, obj.pass_index, obj["wear"] = (0.25, 0.5, 0.75, 1), 3, 0.125
    info, attribute = add(material, "ShaderNodeObjectInfo"), add(material, "ShaderNodeAttribute")
    attribute.attribute_type, attribute.attribute_name = "OBJECT", "wear"
    third = add(material, "ShaderNodeMath", operation="MULTIPLY")
    third.inputs[1].default_value = 0.1
    material.node_tree.links.new(info.outputs["Object Index"], third.inputs[0])
    link(material, info.outputs["Color"], "Base Color")
    link(material, third.outputs[0], "Roughness")
    link(material, attribute.outputs["Fac"], "Metallic")
    read(material, obj, tmp_path)
    maps = read_maps(tmp_path / "maps")
    np.testing.assert_allclose(maps["BaseColor"][8, 8], (0.25, 0.5, 0.75), atol=1e-5)
    np.testing.assert_allclose(maps["Roughness"], 0.3, atol=1e-5)
    np.testing.assert_allclose(maps["Metallic"], 0.125, atol=1e-5)


@pytest.mark.parametrize("owner", ["scene", "view layer"])
def test_attributes_of_the_view_layer(tmp_path, owner):
    material = new_material()
    scene = bpy.context.scene
    (scene if owner == "scene" else scene.view_layers[0])["damp"] = 0.375
    attribute = add(material, "ShaderNodeAttribute")
    attribute.attribute_type, attribute.attribute_name = "VIEW_LAYER", "damp"
    link(material, attribute.outputs["Fac"], "Roughness")
    read(material, plane(material), tmp_path)
    np.testing.assert_allclose(read_maps(tmp_path / "maps")["Roughness"], 0.375, atol=1e-5)


# Several samples a texel


def weave(material: bpy.types.Material, waves: float) -> None:
    """So many light and dark stripes along U."""
    node, coordinates = add(material, "ShaderNodeMath"), add(material, "ShaderNodeTexCoord")
    pattern = add(material, "ShaderNodeTexChecker")
    pattern.inputs["Scale"].default_value = 2 * waves
    pattern.inputs["Color1"].default_value = (0, 0, 0, 1)
    pattern.inputs["Color2"].default_value = (1, 1, 1, 1)
    split, join = add(material, "ShaderNodeSeparateXYZ"), add(material, "ShaderNodeCombineXYZ")
    tree = material.node_tree
    tree.nodes.remove(node)
    tree.links.new(coordinates.outputs["UV"], split.inputs[0])
    tree.links.new(split.outputs[0], join.inputs[0])
    tree.links.new(join.outputs[0], pattern.inputs["Vector"])
    link(material, pattern.outputs["Color"], "Base Color")


@pytest.mark.parametrize("waves", [15.3, 40.7, 163.1])
def test_a_pattern_finer_than_a_texel_is_its_mean(tmp_path, waves):
    """Half is light; at the texels' centers alone there would be light and dark ones, in moire."""
    material = new_material()
    weave(material, waves)
    found = color_of(material, plane(material), tmp_path)[..., 0]
    assert found.mean() == pytest.approx(0.5, abs=0.05)
    assert found.std() < 0.2


def test_a_pattern_that_texels_show_is_sharp(tmp_path):
    material = new_material()
    weave(material, 2)
    found = color_of(material, plane(material), tmp_path)[..., 0]
    assert set(np.unique(found)) == {0.0, 1.0}


@pytest.mark.parametrize("kind", ["Bevel", "AmbientOcclusion"])
def test_noisy_nodes_leave_no_speckles(tmp_path, kind):
    """On a cube's face both are smooth; one sample a texel is three times as rough."""
    material = new_material()
    node = add(material, f"ShaderNode{kind}")
    if kind == "Bevel":
        node.samples, node.inputs["Radius"].default_value = 2, 0.5
        geometry, dot = (
            add(material, "ShaderNodeNewGeometry"),
            add(material, "ShaderNodeVectorMath"),
        )
        dot.operation = "DOT_PRODUCT"
        material.node_tree.links.new(node.outputs[0], dot.inputs[0])
        material.node_tree.links.new(geometry.outputs["True Normal"], dot.inputs[1])
        link(material, dot.outputs["Value"], "Base Color")
    else:
        node.samples, node.inside = 1, True
        node.inputs["Distance"].default_value = 1.0
        link(material, node.outputs["Color"], "Base Color")
    bpy.ops.mesh.primitive_cube_add()
    obj = bpy.context.object
    obj.data.materials.append(material)
    for i, corner in enumerate(obj.data.uv_layers[0].data):
        on_top = i // 4 == 5
        u, v = ((0, 0), (1, 0), (1, 1), (0, 1))[i % 4]
        corner.uv = (u, v) if on_top else (0, 0)
    found = color_of(material, obj, tmp_path)[..., 0]
    rough = found[1:-1, 1:-1] - (found[:-2, 1:-1] + found[2:, 1:-1]) / 2
    assert np.sqrt((rough**2).mean()) < 0.15
    assert found.std() > 0


# Alpha


@pytest.mark.parametrize("linked", [False, True])
@pytest.mark.parametrize("mode", ["STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE"])
@pytest.mark.parametrize("kind", ["png8", "png16", "exr"])
def test_images_with_alpha_are_read_as_cycles_shows_them(tmp_path, kind, mode, linked):
    """In the middle of a plane that shows one color of one alpha, as light."""
    made = image("A", np.full((4, 4, 4), (0.4, 0.2, 0.05, 0.5)), floating=kind != "png8")
    file = tmp_path / ("a.exr" if kind == "exr" else "a.png")
    made.filepath_raw, made.file_format = str(file), "OPEN_EXR" if kind == "exr" else "PNG"
    made.save()
    material = new_material()
    node = add(material, "ShaderNodeTexImage", image=bpy.data.images.load(str(file)))
    node.image.alpha_mode = mode
    link(material, node.outputs["Color"], "Base Color")
    if linked:
        link(material, node.outputs["Alpha"], "Alpha")
    found = color_of(material, plane(material), tmp_path)
    principled = principled_of(material)
    principled.inputs["Roughness"].default_value = 1
    tree = material.node_tree
    emission, mix = add(material, "ShaderNodeEmission"), add(material, "ShaderNodeAddShader")
    tree.links.new(node.outputs["Color"], emission.inputs["Color"])
    if linked:  # so that Cycles sees it used, and adds nothing
        none = add(material, "ShaderNodeMath", operation="MINIMUM")
        tree.links.new(node.outputs["Alpha"], none.inputs[0])
        none.inputs[1].default_value = 0
        extra = add(material, "ShaderNodeEmission")
        tree.links.new(none.outputs[0], extra.inputs["Strength"])
        tree.links.new(extra.outputs[0], mix.inputs[1])
    tree.links.new(emission.outputs[0], mix.inputs[0])
    tree.links.new(mix.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
    view_from_above()
    shown = render(tmp_path / "shown.exr", size=16)[8, 8]
    # Cycles rounds 8-bit colors times alpha to 8 bits.
    np.testing.assert_allclose(found[0, 0], shown, rtol=0.01, atol=2e-3)
