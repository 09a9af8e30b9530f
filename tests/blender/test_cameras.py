"""Textures as large as the cameras see: known views, the way there, and what cannot be told."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.material_cases import (
    add,
    add_sun,
    link,
    new_material,
    plane,
    principled_of,
    procedural,
    read_maps,
    render,
    view_from_above,
)
from tvbrdf.tvbrdf_addon.material.reading.cameras import FULL, TextureSize, all_the_cameras_see
from tvbrdf.tvbrdf_addon.material.reading.read import read
from tvbrdf.tvbrdf_addon.material.reading.space import choose_space

pytestmark = pytest.mark.usefixtures("empty_scene")
OWN = 2048


def textured(material: bpy.types.Material, side: int = OWN) -> bpy.types.Node:
    made = bpy.data.images.new("image", side, side)
    node = add(material, "ShaderNodeTexImage", image=made)
    link(material, node.outputs["Color"], "Base Color")
    return node


@pytest.fixture
def paint() -> bpy.types.Material:
    """Paint with an image of 2048 px on a plane of 2 x 2, which 256 pixels see from above."""
    material = new_material()
    textured(material)
    plane(material)
    view_from_above()
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = 256
    scene.frame_start, scene.frame_end = 1, 40
    return material


def size(material: bpy.types.Material, *, now: bool = False) -> TextureSize:
    return all_the_cameras_see(
        material,
        choose_space(principled_of(material)),
        bpy.context.scene,
        None if now else (1, 40),
        depsgraph=bpy.context.evaluated_depsgraph_get(),
    )


def camera() -> bpy.types.Object:
    return bpy.data.objects["Camera"]


def test_two_texels_a_pixel(paint):
    assert size(paint) == TextureSize(512, "512 px is all the cameras see, of 2048 in the images.")
    assert size(paint, now=True).pixels == 512


def test_the_size_of_the_picture_counts(paint):
    bpy.context.scene.render.resolution_percentage = 50
    assert size(paint).pixels == 256
    bpy.context.scene.render.resolution_x = 4096
    assert size(paint).pixels > 1024


def test_it_is_a_multiple_of_64(paint):
    camera().data.ortho_scale = 2.3
    assert size(paint).pixels == math.ceil(512 / 2.3 * 2 / 64) * 64


def test_nearer_needs_more(paint):
    camera().data.type, camera().data.sensor_fit = "PERSP", "HORIZONTAL"
    camera().data.angle = math.radians(90)  # at a height of 4 it sees 8 units across
    camera().location.z = 4
    assert size(paint).pixels == 128
    camera().location.z = 1
    assert size(paint).pixels == 512


def test_the_nearest_approach_counts(paint):
    camera().data.type, camera().data.sensor_fit = "PERSP", "HORIZONTAL"
    camera().data.angle = math.radians(90)
    for frame, height in ((1, 8), (20, 1), (40, 8)):
        camera().location.z = height
        camera().keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(1)
    assert size(paint, now=True).pixels == 64
    assert 448 <= size(paint).pixels <= 512


def test_what_moves_it_may_be_anything(paint):
    """A parent that is not part of what is looked at."""
    carrier = bpy.data.objects.new("Carrier", None)
    bpy.context.scene.collection.objects.link(carrier)
    plane_object = bpy.data.objects["Plane"]
    plane_object.parent = carrier
    for frame, scale in ((1, 1.0), (40, 2.0)):
        carrier.scale = (scale,) * 3
        carrier.keyframe_insert("scale", frame=frame)
    bpy.context.scene.frame_set(1)
    assert size(paint, now=True).pixels == 512
    assert size(paint).pixels == 1024


def test_modifiers_count(paint):
    paint_object = bpy.data.objects["Plane"]
    modifier = paint_object.modifiers.new("Cast", "SIMPLE_DEFORM")
    modifier.deform_method, modifier.factor = "STRETCH", 1.0
    modifier.deform_axis = "X"
    assert size(paint).pixels > 512


def test_a_mapping_that_repeats_the_texture(paint):
    mapping, uv = add(paint, "ShaderNodeMapping"), add(paint, "ShaderNodeUVMap")
    links = paint.node_tree.links
    links.new(uv.outputs["UV"], mapping.inputs["Vector"])
    textured_node = next(n for n in paint.node_tree.nodes if n.type == "TEX_IMAGE")
    links.new(mapping.outputs["Vector"], textured_node.inputs["Vector"])
    mapping.inputs["Scale"].default_value = (4, 4, 4)
    mapping.inputs["Rotation"].default_value = (0, 0, 1)
    assert size(paint).pixels == 128
    mapping.vector_type = "TEXTURE"
    assert size(paint).pixels == OWN


def test_every_camera_of_the_scene_counts(paint):
    other = bpy.data.objects.new("Near", camera().data.copy())
    other.data.ortho_scale = 1.0
    bpy.context.scene.collection.objects.link(other)
    other.location = (0, 0, 3)
    assert size(paint).pixels == 1024


def test_images_are_never_enlarged(paint):
    camera().data.ortho_scale = 0.1
    assert size(paint) == TextureSize(OWN, "The cameras see all 2048 px of the images.")


def test_shrinking_a_little_is_not_worth_its_blur(paint):
    camera().data.ortho_scale = 2 * 512 / (0.75 * OWN)
    assert size(paint).pixels == OWN


def test_without_images_the_cameras_alone_decide():
    material = new_material()
    procedural(material)
    plane(material)
    view_from_above()
    bpy.context.scene.render.resolution_x = bpy.context.scene.render.resolution_y = 800
    assert size(material).pixels == 1600
    camera().data.ortho_scale = 0.01
    assert size(material).pixels == 2048
    assert size(material).why.startswith("The cameras see more than 2048 px")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda m: bpy.data.objects.remove(camera()), "There is no camera"),
        (lambda m: setattr(camera(), "location", (0, 0, -3)), "No camera sees “Paint”"),
        (lambda m: setattr(bpy.data.objects["Plane"], "hide_render", True), "No camera sees"),
        (lambda m: setattr(camera().data, "type", "PANO"), "A camera is panoramic"),
        (lambda m: looked_up(m, "Generated"), "“Paint” is not looked up by UV"),
        (lambda m: box_projected(m), "“Paint” is not looked up by UV"),
        (lambda m: without_uv(), "“Plane” has no such UV map"),
        (lambda m: on_a_curve(m), "“Curve” is no mesh"),
        (lambda m: instanced(), "Instances show “Paint”"),
    ],
)
def test_what_cannot_be_told_keeps_the_full_size(paint, change: Callable, reason: str):
    change(paint)
    bpy.context.view_layer.update()
    for now in (True, False):
        found = size(paint, now=now)
        assert found.pixels == OWN
        assert found.why.startswith(reason)
        assert found.why.endswith("so the textures keep their full size.")


def looked_up(material: bpy.types.Material, output: str) -> None:
    coordinates = add(material, "ShaderNodeTexCoord")
    node = next(n for n in material.node_tree.nodes if n.type == "TEX_IMAGE")
    material.node_tree.links.new(coordinates.outputs[output], node.inputs["Vector"])


def box_projected(material: bpy.types.Material) -> None:
    next(n for n in material.node_tree.nodes if n.type == "TEX_IMAGE").projection = "BOX"


def without_uv() -> None:
    layers = bpy.data.objects["Plane"].data.uv_layers
    layers.remove(layers[0])


def on_a_curve(material: bpy.types.Material) -> None:
    curve = bpy.data.objects.new("Curve", bpy.data.curves.new("Curve", "CURVE"))
    curve.data.materials.append(material)
    bpy.context.scene.collection.objects.link(curve)


def instanced() -> None:
    many = bpy.data.collections.new("Many")
    many.objects.link(bpy.data.objects["Plane"])
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", many
    bpy.context.scene.collection.objects.link(empty)


def test_the_file_is_left_as_it_was(paint):
    """A pose that was not keyed yet among it, and the frame."""
    for frame, height in ((1, 8), (40, 1)):
        camera().location.z = height
        camera().keyframe_insert("location", frame=frame)
    scene = bpy.context.scene
    scene.frame_set(17)
    camera().location = (0.1, 0.2, 5.0)
    bpy.context.view_layer.update()
    frames, users = [], camera().users
    bpy.app.handlers.frame_change_post.append(lambda changed: frames.append(changed.name))
    size(paint)
    bpy.app.handlers.frame_change_post.pop()
    assert scene.name not in frames
    assert scene.frame_current == 17
    assert tuple(camera().location) == pytest.approx((0.1, 0.2, 5.0))
    assert camera().matrix_world.translation.z == pytest.approx(5.0)
    assert [each.name for each in bpy.data.scenes] == [scene.name]
    assert camera().users == users


def test_what_is_read_has_that_size(paint, tmp_path: Path):
    obj = bpy.data.objects["Plane"]
    options = {"material": paint, "obj": obj, "scene": bpy.context.scene, "folder": tmp_path}
    assert read(**options, size=None).size == (512, 512)
    assert read_maps(tmp_path)["BaseColor"].shape == (512, 512, 3)
    for baked in (1024, 4096):
        assert read(**options, size=baked).size == (OWN, OWN)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Metal024", "Granite002A"])
def test_the_picture_is_the_same_at_that_size(data_folder: Path, tmp_path: Path, name: str):
    """As rendered: the maps that are read against the artist's own images, seen from aside."""
    material = new_material()
    nodes = {"Base Color": "Color", "Roughness": "Roughness"}
    for socket, word in nodes.items():
        (file,) = (data_folder / "pbr" / name).glob(f"*_{word}.*")
        node = add(material, "ShaderNodeTexImage", image=bpy.data.images.load(str(file)))
        if word != "Color":
            node.image.colorspace_settings.name = "Non-Color"
        link(material, node.outputs["Color"], socket)
    principled_of(material).inputs["Metallic"].default_value = 0.5
    obj = plane(material)
    view_from_above()
    camera().data.type, camera().location = "PERSP", (0.0, -1.7, 2.2)
    camera().rotation_euler = (0.6, 0, 0)
    add_sun((0.3, 0.4, -1.0))
    before = render(tmp_path / "before.exr", size=64, samples=256)
    reading = read(material=material, obj=obj, scene=bpy.context.scene, folder=tmp_path, size=None)
    own = max(node.image.size[0] for node in material.node_tree.nodes if node.type == "TEX_IMAGE")
    assert max(reading.size) <= own / 2
    for socket in nodes:
        shown = principled_of(material).inputs[socket].links[0].from_node
        shown.image = bpy.data.images.load(str(tmp_path / f"{socket.replace(' ', '')}.exr"))
        shown.image.colorspace_settings.name = "Non-Color"
    after = render(tmp_path / "after.exr", size=64, samples=256)
    tone = [(1 - np.exp(-2 * np.maximum(each, 0))) ** (1 / 2.8) for each in (before, after)]
    psnr = -10 * np.log10(np.square(tone[0] - tone[1]).mean())
    assert psnr >= 45


def test_a_uniform_material_gets_textures_of_that_size(tmp_path: Path):
    material = new_material()
    obj = plane(material)
    view_from_above()
    bpy.context.scene.render.resolution_x = bpy.context.scene.render.resolution_y = 256
    options = {"material": material, "obj": obj, "scene": bpy.context.scene, "folder": tmp_path}
    reading = read(**options, size=None)
    assert reading.size == (1, 1)
    assert reading.textures.pixels == 512
    bpy.data.objects.remove(camera())
    assert read(**options, size=None).textures.pixels == FULL
