"""README's steps as a newcomer takes them, from the default file on, each state photographed.

Its worker is `stub_worker.py`, beside it.
"""

from __future__ import annotations

import os

import bpy
from windowed_steps import (
    DRAWN,
    EXCHANGE,
    Steps,
    away_with_the_splash_screen,
    go_through,
    redraw,
    shoot,
    sidebar,
    until,
)


def material() -> bpy.types.Material:
    return bpy.data.materials["Material"]


def shading() -> Steps:
    """The default Shading workspace with the tab of the sidebar opened."""
    bpy.context.window.workspace = bpy.data.workspaces["Shading"]
    yield DRAWN
    area = next(a for a in bpy.context.window.screen.areas if a.ui_type == "ShaderNodeTree")
    area.spaces.active.show_region_ui = True
    yield DRAWN
    area = next(a for a in bpy.context.window.screen.areas if a.ui_type == "ShaderNodeTree")
    sidebar(area).active_panel_category = "Age"
    redraw()
    yield 2 * DRAWN


def suits() -> Steps:
    shoot("first")
    inputs = material().node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (0.95, 0.45, 0.25, 1)
    inputs["Metallic"].default_value = 1
    yield from until(lambda: redraw() or material().tvbrdf.ntm == "patina")
    yield DRAWN
    shoot("copper")
    material().tvbrdf.ntm = "rust"
    redraw()
    yield 2 * DRAWN
    shoot("doubt")


def everything() -> Steps:
    os.environ["TVBRDF_WORKER"] = str(EXCHANGE / "stub_worker.py")
    os.environ["TVBRDF_STUB_SECONDS"] = "4"
    yield from away_with_the_splash_screen()
    yield from shading()
    yield from suits()


go_through(everything(), "windowed newcomer")
