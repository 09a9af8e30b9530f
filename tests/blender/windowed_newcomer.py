"""README's steps as a newcomer takes them, from the default file on, each state photographed.

Its worker is `stub_worker.py`, beside it.
"""

from __future__ import annotations

import os
import subprocess

import bpy
from windowed_steps import (
    DRAWN,
    EXCHANGE,
    EXTENSION,
    Steps,
    away_with_the_splash_screen,
    click,
    ended,
    go_through,
    key,
    redraw,
    session,
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
    yield 2 * DRAWN
    # On the picture: all of them.
    yield from click(1095, 680)
    yield DRAWN
    shoot("grid")
    yield from key("Escape")
    with bpy.context.temp_override(**in_shader_editor()):
        bpy.ops.tvbrdf.find_model("INVOKE_DEFAULT")
    yield DRAWN
    subprocess.run(["xdotool", "type", "steel"], check=True)
    yield DRAWN
    shoot("search")
    yield from key("Escape")
    yield from key("Escape")


def ages() -> Steps:
    material().tvbrdf.ntm = "patina"
    redraw()
    yield 2 * DRAWN
    with bpy.context.temp_override(**in_shader_editor()):
        bpy.ops.tvbrdf.age_material("INVOKE_DEFAULT")
    yield from until(lambda: session().current().fraction > 0.3, 60)
    yield DRAWN
    shoot("progress")
    yield from until(ended)
    yield 3 * DRAWN
    shoot("aged")
    assert bpy.context.scene.frame_current == 125
    with bpy.context.temp_override(**in_shader_editor()):
        bpy.ops.tvbrdf.revert()


def in_shader_editor() -> dict[str, object]:
    area = next(a for a in bpy.context.window.screen.areas if a.ui_type == "ShaderNodeTree")
    region = next(each for each in area.regions if each.type == "WINDOW")
    return {"area": area, "region": region}


def in_properties() -> Steps:
    """The default Layout workspace's Material properties."""
    bpy.context.window.workspace = bpy.data.workspaces["Layout"]
    yield DRAWN
    area = next(a for a in bpy.context.window.screen.areas if a.type == "PROPERTIES")
    area.spaces.active.context = "MATERIAL"
    redraw()
    yield 2 * DRAWN
    shoot("properties")
    yield from click(1581, 529)
    yield DRAWN
    shoot("drop_down")
    yield from key("Escape")
    with bpy.context.temp_override(area=area):
        bpy.ops.tvbrdf.age_material("INVOKE_DEFAULT")
    yield from until(lambda: session().current().fraction > 0.3, 60)
    yield DRAWN
    shoot("row_progress")
    yield from until(ended)
    yield 2 * DRAWN
    shoot("row_aged")


def several() -> Steps:
    """All materials of two objects in one action."""
    with bpy.context.temp_override(**in_3d_view()):
        bpy.ops.tvbrdf.revert(material="Material")
        bpy.ops.mesh.primitive_uv_sphere_add(location=(3, 0, 0))
    oak = bpy.data.materials.new("Old Oak")
    oak.use_nodes = True
    bpy.context.object.data.materials.append(oak)
    bpy.data.objects["Cube"].select_set(True)
    # What a script does is no step of its own: the undo that is tried would go back behind it.
    bpy.ops.ed.undo_push(message="Two objects")
    with bpy.context.temp_override(**in_3d_view()):
        bpy.ops.tvbrdf.age_materials("INVOKE_DEFAULT")
    yield from until(lambda: session().current().turn[0] == 2, 60)
    yield from until(lambda: session().current().fraction > 0.3, 60)
    yield DRAWN
    shoot("several")
    yield from until(ended)
    yield DRAWN
    assert material().tvbrdf.original and oak.tvbrdf.original
    assert oak.tvbrdf.ntm == "weathered_wood"
    yield from key("ctrl+z")
    assert not material().tvbrdf.original, "one undo takes all of them back"
    assert not bpy.data.materials["Old Oak"].tvbrdf.original


def in_3d_view() -> dict[str, object]:
    area = next(a for a in bpy.context.window.screen.areas if a.type == "VIEW_3D")
    region = next(each for each in area.regions if each.type == "WINDOW")
    return {"area": area, "region": region}


def has_nothing_to_age() -> Steps:
    """A light, and an object without a material, in the Shading workspace; presets and disk use."""
    yield from shading()
    bpy.context.view_layer.objects.active = bpy.data.objects["Light"]
    redraw()
    yield 2 * DRAWN
    shoot("light")
    cube = bpy.data.objects["Cube"]
    cube.data.materials.clear()
    bpy.context.view_layer.objects.active = cube
    redraw()
    yield 2 * DRAWN
    shoot("no_material")
    with bpy.context.temp_override(**in_shader_editor()):
        bpy.ops.tvbrdf.new_material()
        bpy.ops.wm.call_panel(name="TVBRDF_PT_presets")
    yield 2 * DRAWN
    shoot("presets")
    yield from key("Escape")
    bpy.ops.preferences.addon_show(module=EXTENSION)
    yield 3 * DRAWN
    shoot("preferences")


def everything() -> Steps:
    os.environ["TVBRDF_WORKER"] = str(EXCHANGE / "stub_worker.py")
    os.environ["TVBRDF_STUB_SECONDS"] = "4"
    yield from away_with_the_splash_screen()
    yield from shading()
    yield from suits()
    yield from ages()
    yield from in_properties()
    yield from several()
    yield from has_nothing_to_age()


go_through(everything(), "windowed newcomer")
