"""A newcomer's five clicks from the default file on, with the mouse; each state photographed.

Clicks go to where things lie on a screen of 1600 x 1000; what each is for is looked at after it.
Prints how many there were, and how long it took from Blender's start to the played cube, with the
real worker, cold.  The pictures are whole screens, of which `docs/tutorial.md` shows parts.

With a file `nothing_ages` beside it the third click goes beside the button, and that is all: what
is left is Blender's own time, and the hand's.
"""

from __future__ import annotations

import importlib
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import bpy
from windowed_steps import (
    DRAWN,
    EXCHANGE,
    EXTENSION,
    Steps,
    click,
    ended,
    go_through,
    key,
    outcome,
    redraw,
    session,
    shoot,
    until,
)

BESIDE_SPLASH, MATERIAL_TAB, AGE, MORE = (400, 800), (1339, 783), (1465, 530), (1581, 530)
BESIDE_AGE = (1465, 960)
MATERIAL_PREVIEW, PLAY, MODELS = (1261, 40), (683, 918), (1379, 262)
FRAMES = (1, 90, 250)
# What software takes to draw a material for the first time.
SHADED = 12.0
PATIENCE = 240


class Newcomer:
    """Counts clicks and seconds, the latter from the start of Blender's process."""

    def __init__(self) -> None:
        self.clicks, self.started = 0, _started()

    def clicks_on(self, what: str, at: tuple[int, int], then: Callable[[], bool]) -> Steps:
        self.clicks += 1
        yield from click(*at)
        yield from until(then, PATIENCE)
        self.says(f"click {self.clicks}: {what}")

    def says(self, what: str) -> None:
        print(f"{time.time() - self.started:6.1f} s  {what}", flush=True)


def _started() -> float:
    """When this process began, as `time.time` counts."""
    ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
    up = float(Path("/proc/uptime").read_text().split()[0])
    return time.time() - up + ticks / os.sysconf("SC_CLK_TCK")


def area_of(kind: str) -> bpy.types.Area:
    return next(each for each in bpy.context.window.screen.areas if each.type == kind)


def is_shown_by(context: str) -> bool:
    return area_of("PROPERTIES").spaces.active.context == context


def is_shaded() -> bool:
    return area_of("VIEW_3D").spaces.active.shading.type == "MATERIAL"


def is_playing() -> bool:
    return bpy.context.screen.is_animation_playing


def ages() -> bool:
    return not (EXCHANGE / "nothing_ages").exists()


def forget_earlier_runs() -> None:
    """A newcomer's machine has kept nothing yet, and knows nothing of how long runs take."""
    preferences = importlib.import_module(f"{EXTENSION}.tvbrdf_addon.preferences")
    preferences.user_file("rates.json").unlink(missing_ok=True)
    shutil.rmtree(preferences.user_file("cache"), ignore_errors=True)


def five_clicks() -> Steps:
    new = Newcomer()
    new.says("Blender is open")
    yield from new.clicks_on("beside the splash screen", BESIDE_SPLASH, lambda: True)
    yield from new.clicks_on("Material properties", MATERIAL_TAB, lambda: is_shown_by("MATERIAL"))
    if ages():
        yield from new.clicks_on("Age Material", AGE, lambda: not ended())
    else:
        yield from new.clicks_on("beside Age Material", BESIDE_AGE, lambda: True)
    yield from new.clicks_on("Material Preview", MATERIAL_PREVIEW, is_shaded)
    yield from until(ended, PATIENCE)
    if ages():
        new.says(f"aged: {outcome()}")
    yield from new.clicks_on("Play", PLAY, is_playing)
    first = bpy.context.scene.frame_current
    yield from until(lambda: bpy.context.scene.frame_current != first, PATIENCE)
    new.says(f"it plays; {new.clicks} clicks, load {os.getloadavg()[0]:.1f}")
    bpy.ops.screen.animation_cancel(restore_frame=False)


def looks() -> Steps:
    """The aged cube, near, at some ages."""
    view = area_of("VIEW_3D")
    region = next(each for each in view.regions if each.type == "WINDOW")
    with bpy.context.temp_override(area=view, region=region):
        bpy.ops.view3d.view_selected()
        for _ in range(3):
            bpy.ops.view3d.zoom(delta=-1)
    yield 2.0
    bpy.context.scene.frame_set(FRAMES[1])
    yield SHADED
    shoot("aged")
    view.spaces.active.overlay.show_overlays = False
    for number, frame in enumerate(FRAMES):
        bpy.context.scene.frame_set(frame)
        yield SHADED / 2
        shoot(f"age_{number}")
    view.spaces.active.overlay.show_overlays = True


def panel() -> Steps:
    """What drops down beside the button, and the pictures to choose by."""
    # Materials are slow to draw in software, and a click would come too late.
    area_of("VIEW_3D").spaces.active.shading.type = "SOLID"
    redraw()
    yield 4 * DRAWN
    yield from click(*MORE)
    yield 4 * DRAWN
    shoot("more")
    yield from click(*MODELS)
    yield 4 * DRAWN
    shoot("models")
    yield from key("Escape")
    yield from key("Escape")


def first_states() -> Steps:
    """What the newcomer saw before: when it was under way, nothing was to hold the clicks up."""
    with bpy.context.temp_override(area=area_of("PROPERTIES")):
        bpy.ops.tvbrdf.revert()
    redraw()
    yield 4 * DRAWN
    shoot("start")
    # With a warm worker and few texels a run would be over before it is drawn.
    bpy.context.object.active_material.tvbrdf.size = 4096
    with bpy.context.temp_override(area=area_of("PROPERTIES")):
        bpy.ops.tvbrdf.age_material("INVOKE_DEFAULT")
    yield from until(lambda: ended() or session().current().fraction > 0.2, PATIENCE)
    redraw()
    yield DRAWN
    assert not ended(), "there is no picture of a run that has ended"
    shoot("progress")
    yield from until(ended, PATIENCE)


def everything() -> Steps:
    os.environ.pop("TVBRDF_WORKER", None)
    forget_earlier_runs()
    yield from five_clicks()
    if ages():
        yield from looks()
        yield from panel()
        yield from first_states()


# As soon as Blender listens: a newcomer waits for nothing else.
go_through(everything(), "windowed tutorial", first=0)
