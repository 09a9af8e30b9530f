"""The demo: installs the extension, ages a painted can to rust, and renders five frames of it.

    BLENDER_USER_RESOURCES=PROFILE python demo.py EXTENSION.zip OUTPUT_FOLDER

Leaves `aged.blend`, the texture sequences it shows (`aged/`), `aged.json` and `frame_0001.png` ...
in the output folder.  Whatever was in the profile or in the output folder before is replaced.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import time
from pathlib import Path

import bpy
import demo_scene

FRAMES = 36
SHOWN = (1, 9, 18, 27, 36)
SIZE = 512


def install(extension: Path) -> None:
    profile = Path(os.environ["BLENDER_USER_RESOURCES"])
    shutil.rmtree(profile / "extensions", ignore_errors=True)
    bpy.ops.extensions.package_install_files(
        filepath=str(extension), repo="user_default", enable_on_install=True
    )


def age(body: bpy.types.Object, blend: Path) -> None:
    """What an artist does: save, choose rust, click Age material, save."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, FRAMES
    settings = body.active_material.tvbrdf
    settings.ntm, settings.steps, settings.size = "rust", FRAMES, SIZE
    settings.output = "//aged"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    assert bpy.ops.tvbrdf.age_material() == {"FINISHED"}
    bpy.ops.wm.save_mainfile()


def render(output: Path) -> None:
    scene = bpy.context.scene
    for frame in SHOWN:
        scene.frame_set(frame)
        scene.render.filepath = str(output / f"frame_{frame:04d}.png")
        bpy.ops.render.render(write_still=True)


def main() -> None:
    extension, output = (Path(argument).resolve() for argument in sys.argv[1:])
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir(parents=True)
    seconds = {}

    def timed(stage: str, function, *arguments: object):
        started = time.monotonic()
        result = function(*arguments)
        seconds[stage] = time.monotonic() - started
        return result

    timed("install", install, extension)
    body = demo_scene.build(width=360, height=450, samples=24)
    timed("age", age, body, output / "aged.blend")
    (result,) = (output / "aged").rglob("aged.json")
    shutil.copyfile(result, output / "aged.json")
    timed("render", render, output)

    worker = json.loads(result.read_text(encoding="utf-8"))
    print("Seconds:", ", ".join(f"{stage} {taken:.1f}" for stage, taken in seconds.items()))
    print("Of aging, in the worker:", {k: round(v, 1) for k, v in worker["seconds"].items()})
    print(f"Peak memory of the worker: {worker['peak_rss_mb']:.0f} MB")


main()
