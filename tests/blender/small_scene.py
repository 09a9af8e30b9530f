"""What the scripts that run in Blender share: a quick scene, its picture, the workers behind it."""

from __future__ import annotations

import os
from pathlib import Path

import bpy
import numpy as np

STEPS = 4


def build(folder: Path) -> bpy.types.Material:
    """Save an empty file with one lit plane in `folder`; its material, whose color is baked."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.mesh.primitive_plane_add(size=2)
    plane = bpy.context.object
    material = bpy.data.materials.new("Paint")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    noise, principled = nodes.new("ShaderNodeTexNoise"), nodes["Principled BSDF"]
    links.new(noise.outputs["Color"], principled.inputs["Base Color"])
    principled.inputs["Metallic"].default_value = 0.3
    plane.data.materials.append(material)

    light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "SUN"))
    light.data.energy, light.rotation_euler = 3.0, (0.5, 0.2, 0.0)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (0, 0, 3)
    scene = bpy.context.scene
    scene.collection.objects.link(light)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 8, False
    scene.render.resolution_x = scene.render.resolution_y = 48
    scene.frame_start, scene.frame_end = 1, STEPS

    settings = material.tvbrdf
    settings.ntm, settings.steps, settings.size, settings.output = "rust", STEPS, 64, "//aged"
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "small.blend"))
    return material


def picture(frame: int, file: Path) -> np.ndarray:
    """The frame as Cycles renders it: linear RGBA [48 * 48 * 4], also left in `file` (.exr)."""
    scene = bpy.context.scene
    scene.frame_set(frame)
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(file)
    bpy.ops.render.render(write_still=True)
    return pixels_of(file)


def pixels_of(file: Path) -> np.ndarray:
    """Linear RGBA of a picture, flat."""
    image = bpy.data.images.load(str(file))
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels


def workers() -> list[int]:
    """Process ids of this process's children that run model_runtime."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = status.read_text().rpartition(")")[2].split()[1]
            command = (status.parent / "cmdline").read_bytes()
        except OSError:  # it ended meanwhile
            continue
        if int(parent) == os.getpid() and b"model_runtime" in command:
            found.append(int(status.parent.name))
    return found


def mapped_torch(pid: int) -> set[Path]:
    """The torch libraries that a process has loaded."""
    try:
        maps = Path(f"/proc/{pid}/maps").read_text()
    except OSError:
        return set()
    files = {Path(line.split(maxsplit=5)[5]) for line in maps.splitlines() if "/" in line}
    return {file for file in files if file.name.startswith("libtorch_cpu")}
