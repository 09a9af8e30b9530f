"""The pictures by which models are picked: half a can aged by each, and one for all others.

    BLENDER_USER_RESOURCES=PROFILE python thumbnails.py EXTENSION.zip FOLDER [MODEL ...]

Leaves `MODEL.jpg` beside each model of FOLDER, and `any.jpg`, a can that nothing happens to.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import bpy
import demo_scene
from weathered_objects import FRAMES, MATERIALS, SIZE, install, jerrycan, stage

PIXELS, SAMPLES, QUALITY = 256, 48, 88
FRAME = 17  # about half of it has aged
ANY = "any"
GRAY = ((0.22, 0.22, 0.23), 0.5, 0.0)


def photograph(model: str, path: Path) -> None:
    thing = stage(jerrycan, model)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, FRAMES
    scene.cycles.samples = SAMPLES
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.camera.data.lens = 106
    demo_scene.look_at(scene.camera, (0.02, 0, 0.04))
    with tempfile.TemporaryDirectory() as folder:
        if model != ANY:
            settings = thing.active_material.tvbrdf
            settings.ntm, settings.steps, settings.size = model, FRAMES, SIZE
            bpy.ops.wm.save_as_mainfile(filepath=str(Path(folder) / "can.blend"))
            assert bpy.ops.tvbrdf.age_material() == {"FINISHED"}
        scene.frame_set(FRAME)
        scene.render.filepath = str(path)
        scene.render.image_settings.file_format = "JPEG"
        scene.render.image_settings.quality = QUALITY
        bpy.ops.render.render(write_still=True)


def main() -> None:
    extension, folder, *models = sys.argv[1:]
    install(extension)
    MATERIALS[ANY] = GRAY
    for model in models or MATERIALS:
        path = Path(folder).resolve() / f"{model}.jpg"
        photograph(model, path)
        print(f"{path.name}: {path.stat().st_size / 1024:.0f} KB", flush=True)


if __name__ == "__main__":
    main()
