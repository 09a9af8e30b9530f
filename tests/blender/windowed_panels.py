"""The panel photographed as artists have it: at three widths, in two themes, and on a 4K screen.

Leaves `THEME_WIDTH_fresh.png` and `THEME_WIDTH_aged.png`, each the sidebar alone; on a screen of
more than 3000 pixels everything is twice as large, and one width is enough.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import bpy
from windowed_steps import (
    DRAWN,
    Steps,
    away_with_the_splash_screen,
    ended,
    go_through,
    redraw,
    shoot,
    show_panel,
    sidebar,
    until,
)

THEMES = ("Blender_Dark", "Blender_Light")
WIDTHS = (200, 280, 420)  # px at scale 1
OPEN = ("result", "start", "settings", "advanced", "learn")
PATIENCE = 120


def scale() -> int:
    return 2 if bpy.context.window.width > 3000 else 1


def open_the_subpanels() -> None:
    """No script can open one that was drawn closed, so each is told anew, open."""
    for name in OPEN:
        closed = getattr(bpy.types, f"NODE_PT_tvbrdf_{name}")
        bpy.utils.unregister_class(closed)
        bpy.utils.register_class(
            type(f"NODE_PT_tvbrdf_{name}_open", (closed,), {"bl_options": set()})
        )


def editor() -> bpy.types.Area:
    return next(a for a in bpy.context.window.screen.areas if a.ui_type == "ShaderNodeTree")


def with_theme(name: str) -> None:
    (path,) = (
        each
        for folder in bpy.utils.preset_paths("interface_theme")
        for each in Path(folder).glob(f"{name}.xml")
    )
    bpy.ops.script.execute_preset(
        filepath=str(path), menu_idname="USERPREF_MT_interface_theme_presets"
    )


def drag_to(width: int) -> Steps:
    """Drags the sidebar's edge with the mouse: it has no width that a script could set."""
    region, window = sidebar(editor()), bpy.context.window
    y = window.height - (region.y + region.height // 3)
    target = region.x + region.width - width
    for x, button in ((region.x - 1, "mousedown"), (target, "mouseup")):
        for near in (5, 0):
            subprocess.run(["xdotool", "mousemove", str(x + near), str(y)], check=True)
            yield 0.3
        subprocess.run(["xdotool", button, "1"], check=True)
        yield DRAWN
    subprocess.run(["xdotool", "mousemove", "60", "700"], check=True)
    redraw()
    yield 2 * DRAWN


def photograph(name: str) -> None:
    """The sidebar alone."""
    whole, region = shoot(name), sidebar(editor())
    top = bpy.context.window.height - region.y - region.height
    box = f"{region.width}x{region.height}+{region.x}+{top}"
    subprocess.run(["mogrify", "-crop", box, "+repage", str(whole)], check=True)


def all_looks(state: str) -> Steps:
    for theme in THEMES if scale() == 1 else THEMES[:1]:
        with_theme(theme)
        for width in WIDTHS if scale() == 1 else WIDTHS[1:2]:
            yield from drag_to(width * scale())
            photograph(f"{theme}_{width}_{state}")


def everything() -> Steps:
    os.environ.pop("TVBRDF_WORKER", None)
    yield from away_with_the_splash_screen()
    bpy.context.preferences.view.ui_scale = scale()
    settings = bpy.data.materials["Material"].tvbrdf
    settings.ntm, settings.size = "rust", 256
    yield from show_panel()
    yield 3 * DRAWN
    yield from all_looks("fresh")
    open_the_subpanels()
    bpy.ops.tvbrdf.age_material("INVOKE_DEFAULT", material="Material")
    yield from until(ended, PATIENCE)
    yield from all_looks("aged")


go_through(everything(), "windowed panels")
