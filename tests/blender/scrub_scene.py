"""What is scrubbed: a sphere that shows a result, one modelled frame a frame of the scene."""

from __future__ import annotations

import importlib
import json
import statistics
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import bmesh
import bpy

__all__ = ("build", "show_result", "summary", "timed")


def build() -> bpy.types.Material:
    """Nothing but a lit sphere before a camera; the sphere's material."""
    # No other file, which would have another window.
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    bpy.data.orphans_purge(do_recursive=True)
    material = bpy.data.materials.new("Scrubbed")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    sphere = bpy.data.objects.new("Sphere", _mesh())
    sphere.data.materials.append(material)
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location.z = "ORTHO", 2.2, 5.0
    scene = bpy.context.scene
    for obj in (sphere, light, camera):
        scene.collection.objects.link(obj)
    scene.camera = camera
    return material


def _mesh() -> bpy.types.Mesh:
    shape = bmesh.new()
    shape.loops.layers.uv.new("UVMap")
    bmesh.ops.create_uvsphere(shape, u_segments=64, v_segments=32, radius=1.0, calc_uvs=True)
    for face in shape.faces:
        face.smooth = True
    mesh = bpy.data.meshes.new("Sphere")
    shape.to_mesh(mesh)
    shape.free()
    return mesh


def show_result(extension: str, material: bpy.types.Material, folder: Path) -> dict[str, object]:
    """Bind the result in `folder` over frames 1 to the number that it models; what it is.

    `extension` is the module that the extension is installed as.
    """
    room = f"{extension}.tvbrdf_addon.material"
    bind, read = (importlib.import_module(f"{room}.{name}") for name in ("bind", "read"))
    aged = json.loads((folder / "aged.json").read_text(encoding="utf-8"))
    size, frames = tuple(aged["size"]), len(aged["times"])
    reading = read.Reading(size, read.TextureSize(max(size), ""), False, None, ())
    bind.bind(material=material, reading=reading, folder=folder, frame_start=1, frame_end=frames)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, frames
    textures = [node for node in material.node_tree.nodes if node.type == "TEX_IMAGE"]
    sequences = sum(node.image.source == "SEQUENCE" for node in textures)
    return {
        "result": folder.name,
        "size": size,
        "frames": frames,
        "files": sum(path.suffix == ".exr" for path in folder.iterdir()),
        "sequences": sequences,
        "stills": len(textures) - sequences,
    }


def timed(frames: Iterable[int], show: Callable[[], object]) -> list[float]:
    """Seconds that each frame takes, from the change of the scene to the picture."""
    scene, seconds = bpy.context.scene, []
    for frame in frames:
        started = time.perf_counter()
        scene.frame_set(frame)
        show()
        seconds.append(time.perf_counter() - started)
    return seconds


def summary(still: list[float], first: list[float], again: list[float]) -> dict[str, float]:
    """Frames per second: of the same scene unaged, of the first pass over the frames, and later.

    Medians, of all frames but the first, which also builds the scene.
    """
    passes = {"unaged": still, "first_pass": first, "later_passes": again}
    return {
        f"{name}_fps": round(1 / statistics.median(seconds[1:]), 2)
        for name, seconds in passes.items()
    }
