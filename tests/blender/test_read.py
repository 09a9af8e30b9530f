"""Reading a material: constants, images as they are, refusals, and nothing left behind."""

from __future__ import annotations

import itertools

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import bind, read
from tests.blender.material_cases import (
    add,
    image,
    link,
    made_up,
    new_material,
    plane,
    principled_of,
    procedural,
    read_maps,
    snapshot,
    textured,
)

pytestmark = pytest.mark.usefixtures("empty_scene")
RNG = np.random.default_rng(3)


def srgb_to_linear(value: float) -> float:
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


def test_constants_are_maps_of_one_texel(tmp_path):
    material = new_material()
    material.tvbrdf.onset = "none"
    inputs = principled_of(material).inputs
    inputs["Base Color"].default_value = (0.1, 0.2, 0.3, 1)
    inputs["Metallic"].default_value = 0.25
    inputs["IOR"].default_value = 1.33
    green = add(material, "ShaderNodeRGB")
    green.outputs[0].default_value = (0, 1, 0, 1)
    link(material, green.outputs[0], "Specular Tint")
    link(material, green.outputs[0], "Roughness")
    reading = read(material, None, tmp_path)
    assert reading.uniform
    assert reading.size == (1, 1)
    maps = read_maps(tmp_path / "maps")
    assert set(maps) == {"BaseColor", "Metallic", "Roughness", "Specular", "IOR", "SpecularTint"}
    np.testing.assert_allclose(maps["BaseColor"], [[[0.1, 0.2, 0.3]]], rtol=1e-6)
    np.testing.assert_allclose(maps["Metallic"], 0.25)
    np.testing.assert_allclose(maps["IOR"], 1.33, rtol=1e-6)
    np.testing.assert_allclose(maps["Specular"], 0.5)
    np.testing.assert_allclose(maps["SpecularTint"], [[[0, 1, 0]]])
    np.testing.assert_allclose(maps["Roughness"], 0.7152, rtol=1e-6)  # Rec.709 luminance of green


def test_byte_images_are_read_exactly_top_row_first(tmp_path):
    codes = RNG.integers(0, 256, (4, 8, 3)) / 255
    material = new_material()
    textured(material, codes, colorspace="sRGB")
    textured(material, codes[..., :1].repeat(3, 2), "Roughness")
    reading = read(material, plane(material), tmp_path)
    assert reading.size == (4, 8)
    assert not reading.uniform
    maps = read_maps(tmp_path / "maps")
    np.testing.assert_allclose(maps["BaseColor"], np.vectorize(srgb_to_linear)(codes), atol=1e-6)
    np.testing.assert_allclose(maps["Roughness"][..., 0], codes[..., 0], atol=1e-7)


def test_float_images_are_linear_already(tmp_path):
    values = RNG.random((3, 3, 3)).astype(np.float32)
    material = new_material()
    textured(material, values, floating=True, colorspace="Linear Rec.709")
    read(material, plane(material), tmp_path)
    np.testing.assert_array_equal(read_maps(tmp_path / "maps")["BaseColor"], values)


def test_a_packed_16_bit_png_on_disk(tmp_path):
    codes = (np.arange(12, dtype=np.uint16).reshape(3, 4) * 5000).astype(np.uint16)
    from PIL import Image

    Image.fromarray(codes).save(tmp_path / "gray16.png")
    made = bpy.data.images.load(str(tmp_path / "gray16.png"))
    made.pack()
    (tmp_path / "gray16.png").unlink()
    material = new_material()
    node = add(material, "ShaderNodeTexImage", image=made)
    link(material, node.outputs[0], "Base Color")
    read(material, plane(material), tmp_path)
    expected = np.vectorize(srgb_to_linear)(codes / 65535)
    found = read_maps(tmp_path / "maps")["BaseColor"][..., 0]
    np.testing.assert_allclose(found, expected, atol=2e-4)


def test_through_reroutes_muted_nodes_and_links(tmp_path):
    material = new_material()
    tree = material.node_tree
    node = textured(material, RNG.random((2, 2, 3)))
    reroute, gamma = add(material, "NodeReroute"), add(material, "ShaderNodeGamma")
    gamma.inputs["Gamma"].default_value = 5.0
    gamma.mute = True
    tree.links.new(node.outputs[0], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], gamma.inputs["Color"])
    link(material, gamma.outputs[0], "Base Color")
    link(material, node.outputs[0], "Roughness")
    inputs = principled_of(material).inputs
    inputs["Roughness"].links[0].is_muted = True
    inputs["Roughness"].default_value = 0.3
    reading = read(material, plane(material), tmp_path)
    assert reading.sampling.node is None
    assert reading.size == (2, 2)
    maps = read_maps(tmp_path / "maps")
    assert maps["BaseColor"].shape == (2, 2, 3)
    np.testing.assert_allclose(maps["Roughness"], 0.3)


def test_images_of_different_sizes_are_brought_to_the_largest(tmp_path):
    material = new_material()
    textured(material, RNG.random((4, 4, 3)))
    textured(material, np.full((2, 2, 3), 0.5), "Roughness")
    read(material, plane(material), tmp_path)
    maps = read_maps(tmp_path / "maps")
    assert maps["Roughness"].shape[:2] == (4, 4)
    np.testing.assert_allclose(maps["Roughness"], 0.5, atol=2e-3)


def test_packed_channels_stay_in_the_images_own_space(tmp_path):
    """Occlusion, roughness and metalness in one image, tiled: computed texel by texel."""
    codes = RNG.integers(0, 256, (4, 4, 3)) / 255
    material = new_material()
    tree = material.node_tree
    node = textured(material, codes)
    mapping = add(material, "ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = (3, 3, 3)
    coordinates = add(material, "ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["UV"], mapping.inputs[0])
    tree.links.new(mapping.outputs[0], node.inputs[0])
    split = add(material, "ShaderNodeSeparateColor")
    tree.links.new(node.outputs[0], split.inputs[0])
    link(material, split.outputs[1], "Roughness")
    link(material, split.outputs[2], "Metallic")
    reading = read(material, plane(material), tmp_path)
    assert reading.uv_map is None
    assert reading.sampling.node == mapping.name
    assert reading.laid_out_by is None  # by more than a UV map, though a bake of squares was needed
    maps = read_maps(tmp_path / "maps")
    np.testing.assert_allclose(maps["Roughness"][..., 0], codes[..., 1], atol=1e-6)
    np.testing.assert_allclose(maps["Metallic"][..., 0], codes[..., 2], atol=1e-6)
    np.testing.assert_allclose(maps["BaseColor"], codes, atol=1e-6)


def test_alpha_multiplies_as_blender_does(tmp_path):
    """Where Alpha is not used the color is associated with it; Cycles' own bake is the judge."""
    rgba = RNG.random((2, 2, 4))
    modes = ("STRAIGHT", "CHANNEL_PACKED", "NONE")
    for mode, colorspace in itertools.product(modes, ("sRGB", "Non-Color")):
        material = new_material(mode)
        node = textured(material, rgba, colorspace=colorspace)
        node.image.alpha_mode = mode
        read(material, plane(material), tmp_path)
        found = read_maps(tmp_path / "maps")["BaseColor"]
        baked = baked_square(material, (2, 2))
        np.testing.assert_allclose(found, baked, atol=1e-5, err_msg=mode + colorspace)


def baked_square(material, size: tuple[int, int]) -> np.ndarray:
    from tvbrdf.tvbrdf_addon.material.reading.bake import Target, bake_sockets

    maps, _ = bake_sockets(material.copy(), ["Base Color"], Target(material), size=size, frame=1)
    return maps["Base Color"]


def test_a_sequence_is_read_whose_files_do_not_begin_at_0(tmp_path):
    for number in (1, 2):
        frame = image(f"frame {number}", np.full((4, 8, 3), number / 4, np.float32))
        frame.filepath_raw, frame.file_format = str(tmp_path / f"film_{number:04d}.png"), "PNG"
        frame.save()
    material = new_material()
    film = bpy.data.images.load(str(tmp_path / "film_0001.png"))
    film.source, film.colorspace_settings.name = "SEQUENCE", "Non-Color"
    node = add(material, "ShaderNodeTexImage", image=film)
    node.image_user.frame_duration, node.image_user.use_auto_refresh = 2, True
    link(material, node.outputs["Color"], "Base Color")
    reading = read(material, plane(material), tmp_path)
    assert reading.size == (4, 8)
    first = round(255 / 4) / 255  # as 8 bits hold it
    np.testing.assert_allclose(read_maps(tmp_path / "maps")["BaseColor"], first, atol=1e-3)


def test_beside_a_clipped_image_the_rest_of_the_material_is_read_too(tmp_path):
    material = new_material()
    principled_of(material).inputs["Roughness"].default_value = 0.75
    node = textured(material, np.full((8, 8, 3), 0.5, np.float32), extension="CLIP")
    mapping = add(material, "ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = (2, 2, 2)
    coordinates = add(material, "ShaderNodeTexCoord")
    material.node_tree.links.new(coordinates.outputs["UV"], mapping.inputs["Vector"])
    material.node_tree.links.new(mapping.outputs["Vector"], node.inputs["Vector"])
    reading = read(material, plane(material), tmp_path)
    assert reading.sampling.extension != "CLIP"  # there aged roughness would be 0
    color = read_maps(tmp_path / "maps")["BaseColor"]
    height, width = color.shape[:2]
    assert color[height * 3 // 4, width // 4, 0] == pytest.approx(0.5, abs=3e-3)
    assert color[height // 4, width * 3 // 4, 0] == 0


def test_an_image_of_one_texel_leaves_room_for_a_pattern(tmp_path):
    material = new_material()
    textured(material, np.full((1, 1, 3), 0.5, np.float32))
    reading = read(material, plane(material), tmp_path)
    assert min(reading.size) > 1
    np.testing.assert_allclose(read_maps(tmp_path / "maps")["BaseColor"], 0.5, atol=2e-3)


def test_generated_coordinates_need_no_uvs(tmp_path):
    material = new_material()
    node = textured(material, RNG.random((4, 4, 3)), projection="BOX", projection_blend=0.3)
    coordinates = add(material, "ShaderNodeTexCoord")
    material.node_tree.links.new(coordinates.outputs["Generated"], node.inputs[0])
    obj = plane(material)
    obj.data.uv_layers.remove(obj.data.uv_layers[0])
    reading = read(material, obj, tmp_path)
    assert (reading.sampling.projection, reading.sampling.socket) == ("BOX", "Generated")
    assert reading.sampling.projection_blend == pytest.approx(0.3)


def test_an_aged_material_is_read_as_it_was(tmp_path):
    material = new_material()
    material.tvbrdf.onset = "none"
    principled_of(material).inputs["Roughness"].default_value = 0.125
    obj = plane(material)
    for kind, size in (("principled", 1), ("torrance-sparrow", 4), ("principled-exact", 4)):
        bind(material, obj, made_up(tmp_path / f"{kind}{size}", kind, size=size), tmp_path)
        bpy.context.scene.frame_set(5)
        assert read(material, obj, tmp_path).uniform
        np.testing.assert_allclose(read_maps(tmp_path / "maps")["Roughness"], 0.125)


def test_animated_sockets_are_read_at_the_first_frame(tmp_path):
    material = new_material()
    material.tvbrdf.onset = "none"
    material.tvbrdf.frame_start = 10
    socket = principled_of(material).inputs["Roughness"]
    for value, frame in ((0.0, 0), (1.0, 100)):
        socket.default_value = value
        socket.keyframe_insert("default_value", frame=frame)
    from tvbrdf.tvbrdf_addon.material.nodes.animation import channels

    for point in channels(material.node_tree)[0].keyframe_points:
        point.interpolation = "LINEAR"
    reading = read(material, None, tmp_path)
    np.testing.assert_allclose(read_maps(tmp_path / "maps")["Roughness"], 0.1, rtol=1e-5)
    assert len(reading.lost) == 1
    assert "frame 10" in reading.lost[0]


def test_view_dependence_is_warned_about(tmp_path):
    material = new_material()
    link(material, add(material, "ShaderNodeFresnel").outputs[0], "Metallic")
    (warning,) = read(material, plane(material), tmp_path).lost
    assert "Fresnel" in warning


def test_reading_leaves_nothing_behind(tmp_path):
    material = new_material()
    procedural(material)
    obj = plane(material)
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.scene.render.engine = "BLENDER_WORKBENCH"
    bpy.context.scene.frame_set(17)

    def everything() -> dict[str, object]:
        kinds = ("scenes", "objects", "meshes", "materials", "images", "node_groups", "actions")
        return {
            "data": {kind: [each.name for each in getattr(bpy.data, kind)] for kind in kinds},
            "material": snapshot(material),
            "selection": [each.name for each in bpy.context.selected_objects],
            "active": bpy.context.view_layer.objects.active.name,
            "scene": bpy.context.scene.name,
            "engine": bpy.context.scene.render.engine,
            "frame": bpy.context.scene.frame_current,
            "slots": [(slot.link, slot.material.name) for slot in obj.material_slots],
        }

    before = everything()
    read(material, obj, tmp_path)
    assert everything() == before
