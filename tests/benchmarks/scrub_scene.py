"""What is scrubbed: a sphere that shows a result, one modeled frame a frame of the scene."""

from __future__ import annotations

import importlib
import json
import statistics
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import bmesh
import bpy
import numpy as np

__all__ = ("Taken", "build", "shading", "show_result", "size_of", "summary", "timed")


def build(size: int) -> bpy.types.Material:
    """Nothing but a lit sphere before a camera; the sphere's material, of four maps `size` wide."""
    # No other file, which would have another window.
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    bpy.data.orphans_purge(do_recursive=True)
    material = bpy.data.materials.new("Scrubbed")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    _add_maps(material, size)
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


def _add_maps(material: bpy.types.Material, size: int) -> None:
    """As an artist has them: base color and three gray ones, of 8 bits, random."""
    tree, rng = material.node_tree, np.random.default_rng(0)
    principled = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    for name in ("Base Color", "Metallic", "Roughness", "Specular IOR Level"):
        image = bpy.data.images.new(name, size, size)
        texel = np.ones((size, size, 4), np.float32)
        texel[..., :3] = rng.random((size, size, 3 if name == "Base Color" else 1), np.float32)
        image.pixels.foreach_set(texel.ravel())
        # A file, as images that are only in memory are handed over anew on every render.
        image.filepath_raw = str(Path(bpy.app.tempdir) / f"{name}.png")
        image.file_format = "PNG"
        image.save()
        image.source = "FILE"
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        tree.links.new(node.outputs["Color"], principled.inputs[name])


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
    bind, lookup = (
        importlib.import_module(f"{room}.{name}") for name in ("binding.bind", "reading.lookup")
    )
    aged = json.loads((folder / "aged.json").read_text(encoding="utf-8"))
    size, frames = tuple(aged["size"]), len(aged["times"])
    reading = lookup.Reading(size, lookup.TextureSize(max(size), ""), False, None, ())
    bind.bind(material=material, reading=reading, folder=folder, frame_start=1, frame_end=frames)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, frames
    groups = [node.node_tree for node in material.node_tree.nodes if node.type == "GROUP"]
    nodes = [node for tree in (material.node_tree, *groups) for node in tree.nodes]
    textures = [node for node in nodes if node.type == "TEX_IMAGE"]
    sequences = sum(node.image.source == "SEQUENCE" for node in textures)
    return {
        "result": folder.name,
        "size": size,
        "frames": frames,
        "files": sum(path.suffix in (".exr", ".png") for path in folder.iterdir()),
        "sequences": sequences,
        "stills": len(textures) - sequences,
    }


def size_of(folder: Path) -> int:
    """How wide the maps of a result are."""
    return json.loads((folder / "aged.json").read_text(encoding="utf-8"))["size"][1]


def shading(engine: str) -> float:
    """Core seconds of a picture, 256 px and 16 samples, of a scene that nothing changes."""
    scene = bpy.context.scene
    before = {name: getattr(scene.render, name) for name in _RENDERED}
    samples = scene.cycles.samples, scene.eevee.taa_render_samples
    scene.render.engine = engine
    scene.render.resolution_x = scene.render.resolution_y = 256
    scene.cycles.samples = scene.eevee.taa_render_samples = 16
    bpy.ops.render.render()
    taken = []
    for _ in range(2):
        worked = time.process_time()
        bpy.ops.render.render()
        taken.append(time.process_time() - worked)
    for name, value in before.items():
        setattr(scene.render, name, value)
    scene.cycles.samples, scene.eevee.taa_render_samples = samples
    return round(min(taken), 3)


_RENDERED = ("engine", "resolution_x", "resolution_y")


class Taken(NamedTuple):
    """What a frame took: seconds, and seconds of all threads on whatever cores they had."""

    seconds: float
    core_seconds: float


def timed(frames: Iterable[int], show: Callable[[], object]) -> list[Taken]:
    """What each frame takes, from the change of the scene to the picture."""
    scene, taken = bpy.context.scene, []
    for frame in frames:
        started, worked = time.perf_counter(), time.process_time()
        scene.frame_set(frame)
        show()
        taken.append(Taken(time.perf_counter() - started, time.process_time() - worked))
    return taken


def summary(still: list[Taken], first: list[Taken], again: list[Taken]) -> dict[str, object]:
    """Of the same scene unaged, of the first pass over the frames, and of later ones: frames per
    second as they came, and the work of a frame, which a busy machine does not change.

    Means, of all frames but the first, which also builds the scene; and the worst of later frames,
    as files change on some frames only.
    """
    passes = {"unaged": still, "first_pass": first, "later_passes": again}
    seconds, work = (
        {name: statistics.mean(each[i] for each in taken[1:]) for name, taken in passes.items()}
        for i in range(2)
    )
    work["worst"] = max(each.core_seconds for each in again)
    return {
        "fps": {name: round(1 / each, 2) for name, each in seconds.items()},
        "core_ms": {name: round(1000 * each, 1) for name, each in work.items()},
    }
