"""What a shader makes of a live result: a plane, texel by pixel, each output of the group as light.

Runs in any Blender: `windowed_live.py` renders with EEVEE, `test_live_shading.py` with Cycles.  The
folder of a case holds `authored.exr` (base color), `numbers.exr` (metallic, roughness, level) and
the result, `live`.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import bpy

__all__ = ("FRAMES", "build", "render_ages")

FRAMES = 1000
"""The last frame of the range, which starts at 0."""

IOR, TINT = 1.6, (1.0, 0.75, 0.5)


def build(
    extension: str,
    case: Path,
    ior: float = IOR,
    tint: tuple[float, float, float] = TINT,
) -> bpy.types.Material:
    """The only thing in the scene: a plane whose material, as in the files, ages by the result."""
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    material = bpy.data.materials.new(case.name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    principled = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    color, numbers = (_texture(nodes, case / f"{name}.exr") for name in ("authored", "numbers"))
    separate = nodes.new("ShaderNodeSeparateXYZ")
    color.location, numbers.location, separate.location = (-600, 300), (-800, 0), (-450, 0)
    links.new(color.outputs["Color"], principled.inputs["Base Color"])
    links.new(numbers.outputs["Color"], separate.inputs[0])
    for source, name in zip(
        separate.outputs, ("Metallic", "Roughness", "Specular IOR Level"), strict=True
    ):
        links.new(source, principled.inputs[name])
    principled.inputs["IOR"].default_value = ior
    principled.inputs["Specular Tint"].default_value = (*tint, 1)
    _add_plane(material)
    room = f"{extension}.tvbrdf_addon.material"
    bind, lookup, space = (
        importlib.import_module(f"{room}.{name}")
        for name in ("binding.bind", "reading.lookup", "reading.space")
    )
    size = (color.image.size[1], color.image.size[0])
    sampling = space.Sampling(interpolation="Closest")
    reading = lookup.Reading(size, lookup.TextureSize(max(size), ""), False, None, (), sampling)
    bind.bind(
        material=material, reading=reading, folder=case / "live", frame_start=0, frame_end=FRAMES
    )
    return material


def render_ages(
    material: bpy.types.Material, ages: Sequence[float], engine: str, folder: Path
) -> Iterator[Path]:
    """Renders the outputs of the material's group, side by side, at each age to `age_K.exr`."""
    plane = next(obj for obj in bpy.context.scene.objects if obj.type == "MESH")
    outputs = len(_group(material).outputs)
    for number in range(outputs):
        tile = plane.copy()
        tile.data = plane.data.copy()
        tile.data.materials[0] = _emitting(material, number)
        tile.location.x = 2 * number - (outputs - 1)
        bpy.context.scene.collection.objects.link(tile)
    bpy.data.objects.remove(plane)
    scene = _scene(engine, material, outputs)
    for k, age in enumerate(ages):
        subframe, frame = math.modf(age * FRAMES)
        scene.frame_set(int(frame), subframe=subframe)
        path = folder / f"age_{k}.exr"
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True)
        yield path


def _group(material: bpy.types.Material) -> bpy.types.Node:
    return next(node for node in material.node_tree.nodes if node.type == "GROUP")


def _emitting(material: bpy.types.Material, number: int) -> bpy.types.Material:
    """A copy that shows an output of the group as light."""
    copy = material.copy()
    tree = copy.node_tree
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(_group(copy).outputs[number], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], tree.get_output_node("ALL").inputs["Surface"])
    return copy


def _texture(nodes: bpy.types.Nodes, path: Path) -> bpy.types.Node:
    node = nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.load(str(path), check_existing=False)
    node.image.colorspace_settings.name = "Non-Color"
    # Half floats, in which Cycles makes 0 something more, would blur what is compared.
    node.image.use_half_precision = False
    node.interpolation = "Closest"
    return node


def _add_plane(material: bpy.types.Material) -> None:
    mesh = bpy.data.meshes.new("Plane")
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    mesh.from_pydata([(2 * x - 1, 2 * y - 1, 0) for x, y in corners], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", [number for corner in corners for number in corner])
    mesh.materials.append(material)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 2.0, (0, 0, 3)
    for obj in (bpy.data.objects.new("Plane", mesh), camera):
        bpy.context.scene.collection.objects.link(obj)
    bpy.context.scene.camera = camera


def _scene(engine: str, material: bpy.types.Material, tiles: int) -> bpy.types.Scene:
    scene = bpy.context.scene
    scene.render.engine = engine
    if engine == "CYCLES":
        scene.cycles.samples, scene.cycles.use_denoising = 1, False
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    else:
        scene.eevee.taa_render_samples = 1
        scene.render.filter_size = 0.0
    images = (node.image for node in material.node_tree.nodes if node.type == "TEX_IMAGE")
    width, height = next(images).size
    scene.render.resolution_x, scene.render.resolution_y = tiles * width, height
    scene.camera.data.ortho_scale = 2 * tiles
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.image_settings.color_depth = "32"
    return scene
