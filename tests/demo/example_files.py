"""The example files: a library of aged materials to drag from the Asset Browser, and a scene.

    BLENDER_USER_RESOURCES=PROFILE python example_files.py EXTENSION.zip WORKER_PYTHON FOLDER

Leaves `aged-materials.blend` and its catalog in FOLDER, and `example-scene.blend`, whose can rusts
over 120 frames.  Both hold their textures, and need neither the extension nor scripts.  Texture
sets are CC0, out of the data folder (`TVBRDF_DATA`).  `TVBRDF_EXAMPLE_SIZE` makes what aging adds
smaller than 1024 px, and the pictures coarser, for a quick look.
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy
import demo_scene
import numpy as np
from weathered_objects import install

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("TVBRDF_DATA", ROOT.parent / "shared" / "data"))
RESULTS = "bl_ext.user_default.tvbrdf.tvbrdf_addon.headless.results"
SIZE = int(os.environ.get("TVBRDF_EXAMPLE_SIZE", "1024"))
FRAMES = 120
HALF = 0.5
PICTURE = 256  # what Blender keeps of a preview
SAMPLES = 64 if SIZE >= 1024 else 4
LIBRARY, SCENE = "aged-materials.blend", "example-scene.blend"
CATALOG = "2f6c1d0e-5b1a-4f3e-9d57-8c0b6f3a7e21"


@dataclass(frozen=True)
class Aged:
    """A material of the library: its texture set, the model that ages it, and how it is told."""

    name: str
    textures: str
    model: str
    says: str
    tags: tuple[str, ...]

    @property
    def folder(self) -> Path:
        return DATA / self.textures


LIBRARY_OF = (
    Aged(
        "Painted Steel, Rusting",
        "pbr/PaintedMetal004",
        "rust",
        "Red paint on steel. Rust breaks out in spots that merge, pit and darken",
        ("metal", "paint", "rust"),
    ),
    Aged(
        "Copper, Turning Green",
        "pbr/Metal035",
        "patina",
        "Bare copper. It tarnishes brown, then turns green",
        ("metal", "copper", "patina"),
    ),
    Aged(
        "Painted Planks, Peeling",
        "scans/Planks010",
        "peeling_wood",
        "Gray paint on planks. It cracks and peels to bare wood",
        ("wood", "paint", "peeling"),
    ),
)


def textured(aged: Aged) -> bpy.types.Material:
    """What an artist makes of a texture set: one image for each socket, by the object's UV map."""
    material = bpy.data.materials.new(aged.name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    principled = nodes["Principled BSDF"]
    sockets = {"Color": "Base Color", "Metalness": "Metallic", "Roughness": "Roughness"}
    for row, tag in enumerate((*sockets, "NormalGL")):
        path = next(aged.folder.glob(f"*_{tag}.jpg"), None)
        if path is None:
            continue
        node = nodes.new("ShaderNodeTexImage")
        node.image, node.location = bpy.data.images.load(str(path)), (-900, 300 - 280 * row)
        if tag != "Color":
            node.image.colorspace_settings.name = "Non-Color"
        if tag != "NormalGL":
            links.new(node.outputs["Color"], principled.inputs[sockets[tag]])
            continue
        bend = nodes.new("ShaderNodeNormalMap")
        bend.location = (-560, -540)
        links.new(node.outputs["Color"], bend.inputs["Color"])
        links.new(bend.outputs["Normal"], principled.inputs["Normal"])
    return material


def compute(aged: Aged, python: str, output: Path) -> None:
    """Ages the texture set as a tile: what is dragged onto anything must know no object's shape."""
    command = [python, "-m", "model_runtime", "age", "--input", str(aged.folder)]
    options = {
        "ntm": aged.model,
        "output": output,
        "size": SIZE,
        "binding": "live",
        "format": "principled",
    }
    for name, value in options.items():
        command += [f"--{name}", str(value)]
    subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)


def ball(material: bpy.types.Material, x: float) -> bpy.types.Object:
    """A ball whose UV map shows a texture as wide as high."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, location=(x, 0, 0))
    thing = bpy.context.object
    thing.name = material.name
    layer = thing.data.uv_layers.active.data
    at = np.empty(2 * len(layer), np.float32)
    layer.foreach_get("uv", at)
    at[::2] *= 2
    layer.foreach_set("uv", at)
    thing.data.materials.append(material)
    bpy.ops.object.shade_smooth()
    return thing


def stage(width: int, height: int) -> bpy.types.Object:
    """Light and a camera in an empty file; the camera."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    demo_scene.add_light()
    scene = bpy.context.scene
    camera = scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.lens = 85
    scene.collection.objects.link(camera)
    scene.render.engine, scene.render.film_transparent = "CYCLES", True
    scene.cycles.samples, scene.cycles.use_denoising = SAMPLES, True
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.view_settings.look = "AgX - Medium High Contrast"
    scene.frame_start, scene.frame_end = 1, FRAMES
    return camera


def aim(camera: bpy.types.Object, x: float, distance: float) -> None:
    camera.location = (x, -distance, 0.2 * distance)
    demo_scene.look_at(camera, (x, 0, 0))


def offer(aged: Aged, material: bpy.types.Material, picture: Path) -> None:
    """Makes the material an asset: half aged, and its Age a slider without keys."""
    material.animation_data_clear()
    material["Age"] = HALF
    material.asset_mark()
    data = material.asset_data
    data.description = f"{aged.says}. Drag Age, among the material's Custom Properties, from 0 to 1"
    data.author, data.license = "Age Material", "CC0-1.0"
    data.copyright = f"Textures: {Path(aged.textures).name} by ambientCG (CC0-1.0)"
    data.catalog_id = CATALOG
    for tag in (*aged.tags, "aged"):
        data.tags.new(tag)
    with bpy.context.temp_override(id=material):
        bpy.ops.ed.lib_id_load_custom_preview(filepath=str(picture))


def photograph(thing: bpy.types.Object, camera: bpy.types.Object, path: Path) -> None:
    """The object alone, on nothing."""
    scene = bpy.context.scene
    others = [each for each in scene.objects if each.type == "MESH" and each != thing]
    for each in others:
        each.hide_render = True
    aim(camera, thing.location.x, 5.6)
    size = scene.render.resolution_x, scene.render.resolution_y
    scene.render.resolution_x = scene.render.resolution_y = PICTURE
    scene.frame_set(1 + round(HALF * (FRAMES - 1)))
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    scene.render.resolution_x, scene.render.resolution_y = size
    for each in others:
        each.hide_render = False


def unpacked_name(path: Path) -> str:
    """A name that no other texture has: results call theirs alike."""
    folder = bpy.path.clean_name(path.parent.name)
    return path.name if path.name.startswith(folder) else f"{folder}_{path.name}"


def pack() -> None:
    """Puts all textures into the file, under names that say nothing of this machine."""
    for image in bpy.data.images:
        if image.source == "FILE" and not image.packed_file:
            image.pack()
            image.filepath_raw = f"//textures/{unpacked_name(Path(image.filepath))}"
    for material in bpy.data.materials:
        material.tvbrdf.folder = ""


def save(path: Path) -> None:
    bpy.data.orphans_purge(do_recursive=True)
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True, relative_remap=False)
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB", flush=True)


def make_library(python: str, folder: Path, scratch: Path) -> None:
    """Three balls, a material each; what the Asset Browser shows are the materials."""
    results = importlib.import_module(RESULTS)
    camera = stage(960, 400)
    things = []
    for number, aged in enumerate(LIBRARY_OF):
        material = textured(aged)
        things.append(ball(material, 2.5 * (number - 1)))
        material.tvbrdf.ntm = aged.model
        output = scratch / aged.model
        compute(aged, python, output)
        for warning in results.bind_result(material, bpy.context.scene, "", output):
            print(f"{aged.name}: {warning}")
    for aged, thing in zip(LIBRARY_OF, things, strict=True):
        picture = scratch / f"{aged.model}.png"
        photograph(thing, camera, picture)
        offer(aged, thing.active_material, picture)
    bpy.context.scene.frame_set(1)
    aim(camera, 0, 18)
    pack()
    save(folder / LIBRARY)
    catalogs = f"VERSION 1\n\n{CATALOG}:Aged Materials:Aged Materials\n"
    (folder / "blender_assets.cats.txt").write_text(catalogs, encoding="utf-8")


def make_scene(folder: Path, scratch: Path) -> None:
    """The demo's can, aged by its shape as an artist does it, keyed over the whole range."""
    body = demo_scene.build(width=720, height=900, samples=64)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, FRAMES
    settings = body.active_material.tvbrdf
    settings.ntm, settings.size = "rust", SIZE
    bpy.ops.wm.save_as_mainfile(filepath=str(scratch / SCENE))
    assert bpy.ops.tvbrdf.age_material() == {"FINISHED"}
    scene.frame_set(1 + FRAMES // 2)
    pack()
    save(folder / SCENE)


def main() -> None:
    extension, python, output = sys.argv[1:]
    install(extension)
    folder = Path(output).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        make_library(python, folder, Path(scratch))
        make_scene(folder, Path(scratch))


if __name__ == "__main__":
    main()
