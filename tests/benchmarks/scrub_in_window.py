"""Frame changes in a window: Material Preview, drawn anew on every frame.

Beside it are `scrub_scene.py` and `results`, a folder of results.  Leaves `window.json`, and a
picture of each result's last frame.
"""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Generator
from pathlib import Path

import bpy
import gpu
from scrub_scene import build, shading, show_result, size_of, summary, timed
from windowed_steps import (
    EXCHANGE,
    EXTENSION,
    Steps,
    away_with_the_splash_screen,
    go_through,
    shoot,
)

ENGINE = "BLENDER_EEVEE_NEXT" if bpy.app.version < (5, 0) else "BLENDER_EEVEE"
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


def center(area: bpy.types.Area) -> bytes:
    """The pixels in the middle of the area, as they are on the screen."""
    x = area.x + area.width // 2
    y = bpy.context.window.height - (area.y + area.height // 2)
    crop = ["import", "-window", "root", "-crop", f"40x40+{x}+{y}", "ppm:-"]
    return subprocess.run(crop, check=True, capture_output=True).stdout


def wait_for_shaders(area: bpy.types.Area, last: int) -> Steps:
    """Until the first frame and the last are seen to differ."""
    began = time.monotonic()
    while True:
        seen = []
        for frame in (1, last):
            timed([frame], draw)
            seen.append(center(area))
        if seen[0] != seen[1]:
            return
        assert time.monotonic() - began < PATIENCE, "the frames of the material look all alike"
        yield 1.0


def measure(folder: Path) -> Generator[float, None, dict[str, object]]:
    material = build(size_of(folder))
    yield 1.0
    area = prepare()
    yield 5.0
    still = timed(range(1, 6), draw)
    unaged = shading(ENGINE)
    facts = show_result(EXTENSION, material, folder)
    frames = range(1, facts["frames"] + 1)
    first = timed(frames, draw)
    yield from wait_for_shaders(area, frames[-1])
    again = timed(frames, draw)
    shoot(folder.name)
    facts["viewer"] = f"Material Preview, {area.width} x {area.height} px"
    facts |= summary(still, first, again)
    facts["shading_core_s"] = {"unaged": unaged, "aged": shading(ENGINE)}
    return facts


def everything() -> Steps:
    found: list[dict[str, object]] = []
    yield from away_with_the_splash_screen()
    for folder in sorted((EXCHANGE / "results").iterdir()):
        found.append((yield from measure(folder)))
        report = {"renderer": gpu.platform.renderer_get(), "measured": found}
        (EXCHANGE / "window.json").write_text(json.dumps(report), encoding="utf-8")


go_through(everything(), "scrubbing")
