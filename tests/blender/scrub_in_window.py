"""Frame changes in a window: Material Preview, drawn anew on every frame.

    windowed-blender scrub_in_window.py EXCHANGE_FOLDER EXTENSION.zip

The exchange folder must hold `scrub_scene.py`, numpy for Python 3.13 in `site-packages`, and
`results`, a folder of results.  Leaves `window.json` there, and a picture of each result's last
frame.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator
from pathlib import Path

import bpy
import gpu

EXCHANGE = Path("/exchange")
sys.path[:0] = [str(EXCHANGE), str(EXCHANGE / "site-packages")]
from scrub_scene import build, show_result, summary, timed  # noqa: E402

EXTENSION = "bl_ext.user_default.tvbrdf"
# Shaders are compiled by software, too.
PATIENCE = 120.0


def prepare() -> bpy.types.Area:
    """The largest area as a viewport that shows the camera's view in Material Preview."""
    area = max(bpy.context.window.screen.areas, key=lambda area: area.width * area.height)
    area.ui_type = "VIEW_3D"
    space = area.spaces.active
    space.show_region_ui = space.show_region_toolbar = space.show_gizmo = False
    space.overlay.show_overlays = False
    space.region_3d.view_perspective = "CAMERA"
    space.shading.type = "MATERIAL"
    bpy.context.scene.eevee.taa_samples = 1
    return area


def draw() -> None:
    bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)


def shoot(name: str) -> None:
    subprocess.run(["import", "-window", "root", str(EXCHANGE / f"{name}.png")], check=True)


def centre(area: bpy.types.Area) -> bytes:
    """The pixels in the middle of the area, as they are on the screen."""
    x = area.x + area.width // 2
    y = bpy.context.window.height - (area.y + area.height // 2)
    crop = ["import", "-window", "root", "-crop", f"40x40+{x}+{y}", "ppm:-"]
    return subprocess.run(crop, check=True, capture_output=True).stdout


def wait_for_shaders(area: bpy.types.Area, last: int) -> Iterator[float]:
    """Until the first frame and the last are seen to differ."""
    began = time.monotonic()
    while True:
        seen = []
        for frame in (1, last):
            timed([frame], draw)
            seen.append(centre(area))
        if seen[0] != seen[1]:
            return
        assert time.monotonic() - began < PATIENCE, "the frames of the material look all alike"
        yield 1.0


def measure(folder: Path) -> Iterator[float]:
    material = build()
    yield 1.0
    area = prepare()
    yield 5.0
    still = timed(range(1, 6), draw)
    facts = show_result(EXTENSION, material, folder)
    frames = range(1, facts["frames"] + 1)
    first = timed(frames, draw)
    yield from wait_for_shaders(area, frames[-1])
    again = timed(frames, draw)
    shoot(folder.name)
    facts["viewer"] = f"Material Preview, {area.width} x {area.height} px"
    facts |= summary(still, first, again)
    found.append(facts)


def everything() -> Iterator[float]:
    # Away with the splash screen.
    yield 1.0
    subprocess.run(["xdotool", "key", "Escape"], check=True)
    yield 1.0
    for folder in sorted((EXCHANGE / "results").iterdir()):
        yield from measure(folder)
        report = {"renderer": gpu.platform.renderer_get(), "measured": found}
        (EXCHANGE / "window.json").write_text(json.dumps(report), encoding="utf-8")


found: list[dict[str, object]] = []
steps = everything()


def advance() -> float:
    try:
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
            return next(steps)
    except StopIteration:
        os._exit(0)
    except BaseException:
        traceback.print_exc()
        shoot("failed")
        os._exit(1)


bpy.app.timers.register(advance, first_interval=2, persistent=True)
