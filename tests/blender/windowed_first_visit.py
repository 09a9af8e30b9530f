"""An aged cube in Material Preview and Rendered, visited first in the middle of its range.

What a viewport shows when it is first looked into must be the age of that frame, once Blender has
compiled the shader: until then it shows a white default, and says so.  Leaves `MATERIAL_60.png` and
so on, whole screens of 900 x 700, with the real worker.
"""

from __future__ import annotations

import os

import bpy
import numpy as np
from windowed_steps import (
    EXCHANGE,
    Steps,
    away_with_the_splash_screen,
    ended,
    go_through,
    shoot,
    until,
)

FRAMES = (60, 250, 1)
# What software takes to draw a material, once it is compiled.
SHADED, PATIENCE = 8.0, 240
CUBE = (slice(110, 520), slice(100, 560))  # rows and columns
LEAST = 0.02  # by which the means of two ages differ


def view() -> bpy.types.Area:
    return next(each for each in bpy.context.window.screen.areas if each.type == "VIEW_3D")


def ages() -> Steps:
    settings = bpy.data.materials["Material"].tvbrdf
    settings.ntm, settings.size = "rust", 512
    region = next(each for each in view().regions if each.type == "WINDOW")
    with bpy.context.temp_override(area=view(), region=region):
        bpy.ops.view3d.view_selected()
        bpy.ops.tvbrdf.age_material("INVOKE_DEFAULT", material="Material")
    yield from until(ended, PATIENCE)


def is_right_at_any_frame(shading: str) -> Steps:
    means = []
    for frame in FRAMES:
        bpy.context.scene.frame_set(frame)
        view().spaces.active.shading.type = shading
        yield SHADED / 2
        yield from until(lambda: not bpy.app.is_job_running("SHADER_COMPILATION"), PATIENCE)
        yield SHADED
        image = bpy.data.images.load(str(shoot(f"{shading}_{frame}")))
        width, height = image.size
        pixels = np.array(image.pixels[:]).reshape(height, width, 4)[::-1]
        bpy.data.images.remove(image)
        means.append(pixels[*CUBE, :3].mean())
    middle, old, new = means
    assert new - middle > LEAST and middle - old > LEAST, f"{shading}: {means}"
    print(f"{shading}: right at frames {FRAMES}", flush=True)


def everything() -> Steps:
    os.environ.pop("TVBRDF_WORKER", None)
    yield from away_with_the_splash_screen()
    bpy.data.objects["Light"].data.energy = 3000
    yield from ages()
    aged = str(EXCHANGE / "aged.blend")
    bpy.ops.wm.save_as_mainfile(filepath=aged)
    for shading in ("MATERIAL", "RENDERED"):
        bpy.ops.wm.open_mainfile(filepath=aged)
        yield 1.0
        yield from is_right_at_any_frame(shading)


go_through(everything(), "windowed first visit")
