"""The panel in a window: looked at, clicked, and disturbed in every way while a run goes on.

At the end the command, as only Blender's own program dispatches it.

Its worker is `stub_worker.py`, beside it.  Leaves `panel.png` (before), `exact.png` (its warning),
`preview.png`, `progress.png`, `aged.png`, `start_*.png` (an attribute or an image that says where)
and `properties.png`.  Clicks go to real pixels: buttons are found by giving them a color that
nothing else has.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator

import bpy
import numpy as np
from windowed_steps import (
    DRAWN,
    EXCHANGE,
    Steps,
    away_with_the_splash_screen,
    click,
    ended,
    go_through,
    key,
    outcome,
    redraw,
    session,
    shoot,
    show_panel,
    sidebar,
    until,
)

SIGNAL = (1.0, 0.0, 1.0, 1.0)


def material() -> bpy.types.Material:
    return bpy.data.materials["Painted Steel"]


def is_aged() -> bool:
    return bool(material().tvbrdf.original)


def build_scene() -> None:
    steel = bpy.data.materials["Material"]
    steel.name = "Painted Steel"
    tree = steel.node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise")
    noise.location = (-300, 200)
    tree.links.new(noise.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    steel.tvbrdf.steps = 12
    bpy.context.scene.frame_end = 100
    bpy.ops.wm.save_as_mainfile(filepath=str(EXCHANGE / "scene.blend"))
    # What a script does is no step of its own: the undo that is tried would go back behind it.
    bpy.ops.ed.undo_push(message="Build the scene")


def buttons() -> Iterator[float | list[tuple[int, int]]]:
    """Wait for drawing, then give the centers of the sidebar's buttons, from top to bottom."""
    widget = bpy.context.preferences.themes[0].user_interface.wcol_tool
    usual = tuple(widget.inner)
    widget.inner = SIGNAL
    # Away with the mouse: what it hovers over is brighter.
    subprocess.run(["xdotool", "mousemove", "400", "600"], check=True)
    redraw()
    yield DRAWN
    image = bpy.data.images.load(str(shoot("signal")))
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    widget.inner = usual
    redraw()
    pixels = pixels.reshape(height, width, 4)[::-1]
    magenta = (pixels[..., 0] > 0.9) & (pixels[..., 1] < 0.2) & (pixels[..., 2] > 0.9)
    area = next(a for a in bpy.context.window.screen.areas if a.ui_type == "ShaderNodeTree")
    region = sidebar(area)
    magenta[:, : region.x] = False
    magenta[:, region.x + region.width :] = False
    rows = np.flatnonzero(magenta.sum(axis=1) > 40)
    centers = []
    for group in np.split(rows, np.flatnonzero(np.diff(rows) > 3) + 1):
        if len(group) > 8:
            columns = np.flatnonzero(magenta[group].any(axis=0))
            centers.append((int(columns.min() + 30), int(group.mean())))
    yield centers


def press(number: int) -> Steps:
    """Click the sidebar's button with this number, counted from the top."""
    found: list[tuple[int, int]] = []
    for step in buttons():
        if isinstance(step, float):
            yield step
        else:
            found = step
    assert len(found) > number, f"there are only {len(found)} buttons: {found}"
    x, y = found[number]
    yield from click(x, y)


def start() -> Steps:
    for _ in range(3):
        yield from press(0)
        if session().current() is not None:
            break
        # A click that falls into a moment of work, such as that after a deletion, is lost.
        yield 1.0
    yield from until(lambda: session().current().fraction > 0.1, 60)


def ages_and_undoes() -> Steps:
    yield from start()
    yield from until(lambda: session().current().fraction > 0.5)
    yield DRAWN
    shoot("progress")
    yield from until(ended)
    yield DRAWN
    assert is_aged()
    assert material().node_tree.nodes["Age"]
    shoot("aged")
    yield from key("ctrl+z")
    assert not is_aged(), "one undo takes the whole run back"
    yield from key("ctrl+shift+z")
    assert is_aged()
    # Revert and Freeze are in the first row of buttons.
    yield from press(0)
    assert not is_aged(), "Revert"


def shows_a_preview() -> Steps:
    settings = material().tvbrdf
    settings.size, settings.quality = 896, "exact"
    yield DRAWN
    yield from start()
    assert settings.is_preview and is_aged()
    shoot("preview")
    yield from until(ended)
    assert is_aged() and not settings.is_preview
    settings.size, settings.quality = 64, "balanced"
    yield from press(0)
    assert not is_aged(), "Revert"


def cancels() -> Steps:
    yield from start()
    # While a run goes on, the sidebar has no other button than Cancel.
    yield from press(0)
    yield from until(ended)
    assert not is_aged()
    assert "Canceled" in outcome()
    yield from start()
    yield from key("Escape")
    yield from until(ended)
    assert not is_aged()
    assert "Canceled" in outcome()


def survives_renaming() -> Steps:
    yield from start()
    material().name = "Another Name"
    yield from until(ended)
    renamed = bpy.data.materials["Another Name"]
    assert renamed.tvbrdf.original
    renamed.name = "Painted Steel"
    yield from press(0)
    assert not is_aged()


def ends_on_undo() -> Steps:
    bpy.ops.ed.undo_push(message="before")
    material().tvbrdf.seed = 5
    bpy.ops.ed.undo_push(message="seed")
    yield from start()
    yield from key("ctrl+z")
    yield from until(ended)
    assert not is_aged()
    assert "undo" in outcome()


def ends_on_deletion() -> Steps:
    copy = material().copy()
    bpy.context.object.active_material = copy
    yield DRAWN
    yield from start()
    bpy.data.materials.remove(copy)
    yield from until(ended)
    assert "deleted" in outcome()
    bpy.context.object.active_material = material()


def ends_on_loading() -> Steps:
    yield from start()
    bpy.ops.wm.open_mainfile(filepath=str(EXCHANGE / "scene.blend"))
    yield from until(ended)
    yield DRAWN
    assert not is_aged()
    assert "another file" in outcome()


def says_where_it_starts() -> Steps:
    """The rows of the subpanel, in each state that they have."""
    # No script can open one that was drawn closed.
    closed = bpy.types.NODE_PT_tvbrdf_advanced
    bpy.utils.unregister_class(closed)
    bpy.utils.register_class(type("NODE_PT_tvbrdf_opened", (closed,), {"bl_options": set()}))
    settings, mesh = material().tvbrdf, bpy.context.object.data
    settings.onset = "attribute"
    redraw()
    yield DRAWN
    shoot("start_missing")
    mesh.color_attributes.new("Wear", "BYTE_COLOR", "CORNER")
    mesh.color_attributes.active_color_name = settings.onset_attribute = "Wear"
    settings.onset_invert = True
    redraw()
    yield DRAWN
    shoot("start_attribute")
    settings.onset = "image"
    redraw()
    yield DRAWN
    shoot("start_new_image")
    settings.onset_image = bpy.data.images.new("Rust Mask", 64, 64)
    settings.onset_invert = False
    redraw()
    yield DRAWN
    shoot("start_image")
    settings.onset = "auto"


def properties_editor() -> Steps:
    area = max(bpy.context.window.screen.areas, key=lambda area: area.width * area.height)
    area.ui_type = "PROPERTIES"
    yield DRAWN
    area.spaces.active.context = "MATERIAL"
    yield DRAWN
    # Blender's own panels come first and are long.
    subprocess.run(["xdotool", "mousemove", "400", "300"], check=True)
    yield 0.2
    subprocess.run(["xdotool", "click", "--repeat", "60", "--delay", "10", "5"], check=True)
    yield DRAWN
    shoot("properties")


def age_by_command(name: str) -> subprocess.CompletedProcess[str]:
    """`--command age_material` in a second Blender, which has no window."""
    path = f"import sys; sys.path.insert(0, {str(EXCHANGE / 'site-packages')!r})"
    scene, aged = str(EXCHANGE / "scene.blend"), str(EXCHANGE / "by_command.blend")
    blender = ["blender", "-b", scene, "--python-expr", path, "--command", "age_material"]
    words = ["--material", name, "--ntm", "rust", "--frames", "1-40", "--steps", "3"]
    return subprocess.run(
        [*blender, *words, "--output", "//by_command", "--save-as", aged],
        capture_output=True,
        text=True,
        check=False,
    )


def command() -> Steps:
    done = age_by_command("Painted Steel")
    assert done.returncode == 0, done.stdout + done.stderr
    assert (EXCHANGE / "by_command" / "Painted Steel" / "aged.json").is_file()
    assert (EXCHANGE / "by_command.blend").is_file()
    failed = age_by_command("Painted Steal")
    assert failed.returncode == 1
    assert "Did you mean Painted Steel?" in failed.stderr
    yield DRAWN


def everything() -> Steps:
    os.environ["TVBRDF_WORKER"] = str(EXCHANGE / "stub_worker.py")
    os.environ["TVBRDF_STUB_SECONDS"] = "12"
    yield from away_with_the_splash_screen()
    build_scene()
    yield from show_panel()
    # Until it has looked through the camera.
    yield 3 * DRAWN
    shoot("panel")
    settings = material().tvbrdf
    settings.quality, settings.temporal_model = "exact", "lstm_latents"
    redraw()
    yield DRAWN
    shoot("exact")
    settings.quality, settings.temporal_model, settings.size = "balanced", "auto", 64
    yield from ages_and_undoes()
    yield from shows_a_preview()
    yield from cancels()
    yield from survives_renaming()
    yield from ends_on_undo()
    yield from ends_on_deletion()
    yield from ends_on_loading()
    yield from says_where_it_starts()
    yield from properties_editor()
    yield from command()


go_through(everything(), "windowed panel")
