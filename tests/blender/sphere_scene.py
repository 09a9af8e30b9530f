"""The metric's sphere in Cycles: ten materials in one picture, lit by one environment map."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from model_runtime.brdf import principled
from model_runtime.maps import TorranceSparrowMaps
from tests.blender.material_cases import add, image, new_material, pixels, principled_of

__all__ = ("add_spheres", "light_by", "render_spheres", "show")

COLUMNS = 5
SEGMENTS, RINGS = 128, 64


def add_spheres(count: int) -> list[bpy.types.Object]:
    """Unit spheres side by side before an orthographic camera; none is seen in or shades another.

    The metric's axes x (right), y (up), z (towards the viewer) are Blender's y, z, x: so an
    equirectangular map stands as it does there, its middle column behind the camera.
    """
    rows = -(-count // COLUMNS)
    scene = bpy.context.scene
    data = bpy.data.cameras.new("Camera")
    data.type, data.ortho_scale = "ORTHO", 2.0 * max(COLUMNS, rows)
    camera = bpy.data.objects.new("Camera", data)
    camera.location, camera.rotation_euler = (5, 0, 0), (np.pi / 2, 0, np.pi / 2)
    scene.collection.objects.link(camera)
    scene.camera = camera
    bpy.ops.mesh.primitive_uv_sphere_add(segments=SEGMENTS, ring_count=RINGS)
    bpy.ops.object.shade_smooth()
    first = bpy.context.object
    first.data.materials.append(None)
    first.visible_shadow = first.visible_diffuse = first.visible_glossy = False
    first.material_slots[0].link = "OBJECT"
    spheres = [first, *(first.copy() for _ in range(count - 1))]
    for index, sphere in enumerate(spheres):
        row, column = divmod(index, COLUMNS)
        sphere.location = (0, 2 * column - COLUMNS + 1, rows - 1 - 2 * row)
        if sphere is not first:
            scene.collection.objects.link(sphere)
    return spheres


def show(spheres: list[bpy.types.Object], materials: TorranceSparrowMaps) -> None:
    """Give sphere i the material of row i of `materials` [n, 1]."""
    for i, sphere in enumerate(spheres):
        parts = (getattr(materials, name)[i : i + 1] for name in ("kd", "ks", "alpha"))
        sphere.material_slots[0].material = _material(TorranceSparrowMaps(*parts))


def light_by(radiance: np.ndarray) -> None:
    """Surround the scene with an equirectangular map [H, W, 3], rows from the top, unsmoothed."""
    world = bpy.data.worlds.new("Surroundings")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    nodes = world.node_tree.nodes
    texture = nodes.new("ShaderNodeTexEnvironment")
    texture.image = image("Surroundings", radiance, floating=True)
    texture.interpolation = "Closest"
    world.node_tree.links.new(texture.outputs[0], nodes["Background"].inputs["Color"])
    bpy.context.scene.world = world


def render_spheres(file: Path, count: int, *, size: int, samples: int, seed: int) -> np.ndarray:
    """Radiance [n, size, size, 3] of each sphere by light that was reflected once."""
    rows = -(-count // COLUMNS)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.film_transparent = True
    cycles = scene.cycles
    cycles.samples, cycles.seed = samples, seed
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.max_bounces = 0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = cycles.blur_glossy = 0
    cycles.pixel_filter_type = "BOX"
    scene.render.resolution_x, scene.render.resolution_y = COLUMNS * size, rows * size
    scene.render.resolution_percentage = 100
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
    scene.render.filepath = str(file)
    bpy.ops.render.render(write_still=True)
    cells = pixels(file).reshape(rows, size, COLUMNS, size, 3).swapaxes(1, 2)
    return cells.reshape(-1, size, size, 3)[:count]


def _material(one: TorranceSparrowMaps) -> bpy.types.Material:
    """Torrance-Sparrow to the digit: the exact mapping, or where it ends the sum of two BSDFs."""
    material = new_material()
    if principled.representable(one):
        node = principled_of(material)
        node.distribution = "GGX"
        base, tint, roughness = principled.exact(one)
        node.inputs["Base Color"].default_value = (*base[0, 0], 1)
        node.inputs["Specular Tint"].default_value = (*tint[0, 0], 1)
        node.inputs["Roughness"].default_value = roughness[0, 0]
        node.inputs["Metallic"].default_value = 0.0
        node.inputs["IOR"].default_value = 17.94
        node.inputs["Specular IOR Level"].default_value = 0.5
        return material
    tree = material.node_tree
    diffuse = add(material, "ShaderNodeBsdfDiffuse")
    glossy = add(material, "ShaderNodeBsdfAnisotropic", distribution="GGX")
    both = add(material, "ShaderNodeAddShader")
    diffuse.inputs["Color"].default_value = (*one.kd[0, 0], 1)
    glossy.inputs["Color"].default_value = (*one.ks[0, 0], 1)
    glossy.inputs["Roughness"].default_value = float(np.sqrt(one.alpha[0, 0]))
    for shader, slot in zip((diffuse, glossy), both.inputs, strict=True):
        tree.links.new(shader.outputs[0], slot)
    tree.links.new(both.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
    return material
