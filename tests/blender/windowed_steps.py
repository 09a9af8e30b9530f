"""What scripts in a window share.  They are generators that yield how long to wait, in seconds.

`windowed.py` starts them, with whatever they need in `EXCHANGE`.  Screenshots and keys go through
the virtual screen, as Blender's own screenshots are black there.
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import bpy

EXCHANGE = Path("/exchange")
EXTENSION = "bl_ext.user_default.tvbrdf"
# What a script has to wait for Blender to draw, and for a click to arrive.
DRAWN = 0.7

Steps = Iterator[float]


def session() -> ModuleType:
    return importlib.import_module(f"{EXTENSION}.tvbrdf_addon.session")


def ended() -> bool:
    return session().current() is None


def outcome() -> str:
    return " ".join(session().outcome().sentences)


def key(name: str) -> Steps:
    subprocess.run(["xdotool", "key", name], check=True)
    yield DRAWN


def click(x: int, y: int) -> Steps:
    """A click at a place of the screen; twice moved to, as what lies under a still mouse is not
    found.
    """
    for near in (4, 0):
        subprocess.run(["xdotool", "mousemove", str(x - near), str(y)], check=True)
        yield 0.3
    subprocess.run(["xdotool", "click", "1"], check=True)
    yield DRAWN


def away_with_the_splash_screen() -> Steps:
    yield 1.0
    yield from key("Escape")


def until(condition: Callable[[], bool], seconds: float = 20) -> Steps:
    waited = 0.0
    while not condition():
        assert waited < seconds, "it did not happen in time"
        waited += 0.1
        yield 0.1


def shoot(name: str) -> Path:
    path = EXCHANGE / f"{name}.png"
    subprocess.run(["import", "-window", "root", str(path)], check=True)
    return path


def redraw() -> None:
    for area in bpy.context.window.screen.areas:
        area.tag_redraw()


def show_panel() -> Steps:
    """Show the sidebar's tab in a Shader Editor."""
    area = max(bpy.context.window.screen.areas, key=lambda area: area.width * area.height)
    area.ui_type = "ShaderNodeTree"
    area.spaces.active.show_region_ui = True
    yield DRAWN
    area = next(a for a in bpy.context.window.screen.areas if a.ui_type == "ShaderNodeTree")
    sidebar(area).active_panel_category = "Age"
    area.tag_redraw()


def sidebar(area: bpy.types.Area) -> bpy.types.Region:
    return next(region for region in area.regions if region.type == "UI")


def go_through(steps: Steps, name: str, *, first: float = 2) -> None:
    """Take the steps in a timer, `first` seconds from now, then end Blender: with 0 where all is
    well.
    """

    def advance() -> float:
        try:
            with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
                return next(steps)
        except StopIteration:
            print(f"{name}: all is well", flush=True)
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            sys.stdout.flush()
            shoot("failed")
            os._exit(1)

    bpy.app.timers.register(advance, first_interval=first, persistent=True)
