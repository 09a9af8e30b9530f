"""The picture of what every model does to things: five objects, eleven models, three ages.

    BLENDER_USER_RESOURCES=PROFILE python weathered_objects.py EXTENSION.zip OUTPUT.jpg [MODEL ...]

A row a model, three pictures an object.  Each object is aged by the extension as an artist does it,
with all defaults but for the size.  Prints a table: the seam ratio of each, and what growing took.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import bpy
import demo_scene
import numpy as np

import bmesh  # isort: skip  (it is there once bpy is)

PIXELS, SAMPLES, SIZE, FRAMES = 200, 16, 1024, 36
SHOWN = (1, 15, 30)

MATERIALS: dict[str, tuple[tuple[float, float, float], float, float]] = {
    "rust": ((0.045, 0.13, 0.115), 0.35, 0.0),
    "peeling_metal": ((0.03, 0.09, 0.24), 0.35, 0.0),
    "patina": ((0.86, 0.45, 0.28), 0.28, 1.0),
    "peeling_wood": ((0.5, 0.42, 0.26), 0.45, 0.0),
    "weathered_wood": ((0.42, 0.22, 0.1), 0.45, 0.0),
    "char": ((0.42, 0.24, 0.11), 0.55, 0.0),
    "drying": ((0.16, 0.09, 0.05), 0.25, 0.0),
    "fading": ((0.45, 0.03, 0.03), 0.45, 0.0),
    "soiling": ((0.52, 0.49, 0.43), 0.75, 0.0),
    "yellowing": ((0.75, 0.75, 0.72), 0.3, 0.0),
    "moss": ((0.3, 0.28, 0.25), 0.85, 0.0),
}
"""What ages: color, roughness, metallic."""


def mesh_of(name: str, build: Callable[[bmesh.types.BMesh], None]) -> bpy.types.Object:
    shape, mesh = bmesh.new(), bpy.data.meshes.new(name)
    build(shape)
    shape.to_mesh(mesh)
    shape.free()
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def moved(shape: bmesh.types.BMesh, made: dict, place: tuple, scale: tuple = (1, 1, 1)) -> None:
    bmesh.ops.scale(shape, vec=scale, verts=made["verts"])
    bmesh.ops.translate(shape, vec=place, verts=made["verts"])


def cylinder(shape: bmesh.types.BMesh, radius: float, depth: float, place: tuple) -> None:
    made = bmesh.ops.create_cone(
        shape, cap_ends=True, segments=64, radius1=radius, radius2=radius, depth=depth
    )
    moved(shape, made, place)


def box(shape: bmesh.types.BMesh, place: tuple, size: tuple) -> None:
    moved(shape, bmesh.ops.create_cube(shape, size=1), place, size)


def jerrycan() -> bpy.types.Object:
    return demo_scene.add_body(steps=120)


def monkey() -> bpy.types.Object:
    def build(shape: bmesh.types.BMesh) -> None:
        bmesh.ops.create_monkey(shape)

    thing = mesh_of("Monkey", build)
    thing.modifiers.new("Smooth", "SUBSURF").levels = 2
    return thing


def pipe() -> bpy.types.Object:
    def build(shape: bmesh.types.BMesh) -> None:
        cylinder(shape, 0.42, 2.5, (0, 0, 0))
        for height in (-1.2, -1.04, 1.04, 1.2):
            cylinder(shape, 0.66, 0.14, (0, 0, height))
        for height in (-1.12, 1.12):
            for turn in np.arange(8) * math.tau / 8:
                cylinder(shape, 0.055, 0.46, (0.54 * np.cos(turn), 0.54 * np.sin(turn), height))

    return mesh_of("Pipe", build)


def wall() -> bpy.types.Object:
    def build(shape: bmesh.types.BMesh) -> None:
        box(shape, (0, 0.1, 0), (2.3, 0.25, 2.5))
        box(shape, (0, -0.16, 0.25), (1.3, 0.35, 0.12))
        for x in (-0.8, -0.3, 0.3, 0.8):
            made = bmesh.ops.create_uvsphere(shape, u_segments=24, v_segments=16, radius=0.09)
            moved(shape, made, (x, -0.03, 0.9))

    return mesh_of("Wall", build)


def statue() -> bpy.types.Object:
    def build(shape: bmesh.types.BMesh) -> None:
        box(shape, (0, 0, -1.15), (1.3, 1.3, 0.25))
        box(shape, (0, 0, -0.9), (0.95, 0.95, 0.3))
        for place, size in (
            ((0, 0, -0.35), (0.42, 0.34, 0.75)),
            ((0, 0, 0.3), (0.52, 0.36, 0.5)),
            ((-0.45, -0.1, 0.25), (0.16, 0.16, 0.5)),
            ((0.45, -0.15, 0.5), (0.16, 0.3, 0.3)),
            ((0, -0.02, 0.95), (0.27, 0.29, 0.34)),
        ):
            made = bmesh.ops.create_icosphere(shape, subdivisions=4, radius=1)
            moved(shape, made, place, size)

    thing = mesh_of("Statue", build)
    remesh = thing.modifiers.new("Remesh", "REMESH")
    remesh.mode, remesh.voxel_size, remesh.use_smooth_shade = "VOXEL", 0.035, True
    return thing


OBJECTS = (jerrycan, monkey, pipe, wall, statue)


def unwrap(thing: bpy.types.Object) -> None:
    """As an artist would: modifiers applied, Smart UV Project, if it has no UVs."""
    bpy.context.view_layer.objects.active = thing
    bpy.ops.object.select_all(action="DESELECT")
    thing.select_set(True)
    for modifier in list(thing.modifiers):
        bpy.ops.object.modifier_apply(modifier=modifier.name)
    if thing.data.uv_layers:
        return
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(angle_limit=math.radians(66), island_margin=0.004)
    bpy.ops.object.mode_set(mode="OBJECT")


def stage(build: Callable[[], bpy.types.Object], model: str) -> bpy.types.Object:
    """The object on a plain ground, in the demo's light."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    thing = build()
    unwrap(thing)
    color, roughness, metallic = MATERIALS[model]
    thing.data.materials.clear()
    thing.data.materials.append(demo_scene.plain("Aging", color, roughness, metallic))
    lowest = min((thing.matrix_world @ vertex.co).z for vertex in thing.data.vertices)
    ground = mesh_of("Ground", lambda shape: box(shape, (0, 0, lowest - 0.5), (60, 60, 1)))
    ground.data.materials.append(demo_scene.plain("Ground", (0.42, 0.4, 0.37), 0.8))
    demo_scene.add_light()
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.lens = 92
    camera.location = (-2.4, -6.3, 2.0)
    scene.collection.objects.link(camera)
    demo_scene.look_at(camera, (0, 0, 0))
    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = SAMPLES, True
    scene.cycles.max_bounces = 3
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.render.use_persistent_data = True
    scene.view_settings.look = "AgX - Medium High Contrast"
    bpy.context.view_layer.objects.active = thing
    return thing


def tiles(build: Callable[[], bpy.types.Object], model: str, folder: Path) -> list[np.ndarray]:
    """Pictures [PIXELS, PIXELS, 3] of the object as it ages, upside down as Blender has them."""
    thing = stage(build, model)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, FRAMES
    settings = thing.active_material.tvbrdf
    settings.ntm, settings.steps, settings.size = model, FRAMES, SIZE
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "object.blend"))
    assert bpy.ops.tvbrdf.age_material() == {"FINISHED"}
    found = []
    for frame in SHOWN:
        scene.frame_set(frame)
        scene.render.filepath = str(folder / "tile.png")
        bpy.ops.render.render(write_still=True)
        picture = bpy.data.images.load(scene.render.filepath, check_existing=False)
        pixels = np.array(picture.pixels[:], np.float32).reshape(PIXELS, PIXELS, -1)
        found.append(pixels[..., :3])
        bpy.data.images.remove(picture)
    return found


def save(picture: np.ndarray, path: Path) -> None:
    height, width, _ = picture.shape
    image = bpy.data.images.new("Sheet", width, height)
    image.pixels[:] = np.dstack((picture, np.ones((height, width), np.float32))).ravel().tolist()
    image.filepath_raw, image.file_format = str(path), "JPEG"
    image.save()


def install(extension: str) -> None:
    profile = Path(os.environ["BLENDER_USER_RESOURCES"])
    shutil.rmtree(profile / "extensions", ignore_errors=True)
    bpy.ops.extensions.package_install_files(
        filepath=extension, repo="user_default", enable_on_install=True
    )


def main() -> None:
    extension, output, *models = sys.argv[1:]
    install(extension)
    rows, table = [], []
    for model in models or MATERIALS:
        row, cells = [], []
        for build in OBJECTS:
            started = time.monotonic()
            with tempfile.TemporaryDirectory() as folder:
                row += tiles(build, model, Path(folder))
                (report,) = Path(folder).rglob("aged.json")
                told = json.loads(report.read_text(encoding="utf-8"))
            ratio = told["seam_ratio"]
            said = "no seam" if ratio is None else f"{ratio:.2f}"
            cells.append(f"{said}, {told['seconds']['onset']:.1f} s")
            took = time.monotonic() - started
            print(f"{model} on {build.__name__}: {cells[-1]} of {took:.0f} s", flush=True)
        table.append(" | ".join((f"| {model}", *cells)) + " |")
        rows.append(np.concatenate(row, 1))
    save(np.concatenate(rows[::-1], 0), Path(output).resolve())
    print("| | " + " | ".join(build.__name__ for build in OBJECTS) + " |")
    print("|---" * (len(OBJECTS) + 1) + "|", *table, sep="\n")


if __name__ == "__main__":
    main()
