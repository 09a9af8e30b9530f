"""The main panel: which model, the one action, how far it is, and what came of it.

All of it is to be in sight at once in the default Shading workspace: what is rarely set lies in
panels below, closed.
"""

from __future__ import annotations

import bpy

from ..model_runtime.contract import EXACT
from . import mixing, properties, session, strengths, suiting
from .destination import is_kept_apart
from .drawing import guarded, is_narrow, paragraph
from .estimate import in_bytes, in_time
from .known import scene_of
from .material.nodes.age import age_path
from .material.nodes.revert import is_aged
from .models import purpose_of
from .operators import can_have_material, material_of
from .outlook import look_soon, outlook_of
from .rates import LONG_SECONDS
from .run import Run, why_not
from .sharing import left_out

__all__ = ("draw", "draw_row")

_PICTURE, _POPUP = 4.6, 7.4  # in heights of a button
_BESIDE = 0.42  # the picture's share of the width


def _time_left(seconds: float) -> str:
    if seconds < 10:
        return "a few seconds left"
    if seconds < 90:
        return f"about {round(seconds, -1):.0f} s left"
    return f"about {seconds / 60:.0f} min left"


@guarded
def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    material = material_of(context)
    if material is None:
        _draw_nothing(layout, context)
        return
    run = session.current()
    column = layout.column()
    column.enabled = run is None and material.library is None
    _draw_model(column, context, material)
    if run is not None:
        _draw_progress(layout, run)
    else:
        _draw_action(layout, context, material)
        _draw_outcome(layout, context, material)


def _draw_nothing(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Why there is nothing to age, and the way out."""
    if not can_have_material(context.object):
        paragraph(layout, context, "Select an object with a surface, such as a mesh.", "INFO")
        return
    paragraph(layout, context, f"“{context.object.name}” has no material yet.", "INFO")
    layout.operator("tvbrdf.new_material", icon="ADD")


@guarded
def draw_row(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """What there is to do with a material, in one row; the rest of the panel drops down."""
    material = context.material
    if material is None or material.library is not None:
        return
    row = layout.row(align=True)
    run, path = session.current(), age_path(material)
    if run is not None:
        row.progress(factor=run.progress, text=f"Aging {run.name} {run.progress:.0%}")
        row.operator("tvbrdf.cancel", text="", icon="X")
    elif is_aged(material) and path is not None:
        row.prop(material, path, text="Age", slider=True)
    else:
        row.operator("tvbrdf.age_material", text="Age Material")
    row.popover("PROPERTIES_PT_tvbrdf_drop_down", text="", icon="DOWNARROW_HLT")


def _draw_model(
    layout: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material
) -> None:
    settings = material.tvbrdf
    look_soon(material, scene_of(context))
    split = layout.split(factor=_BESIDE)
    split.template_icon_view(settings, "ntm", show_labels=True, scale=_PICTURE, scale_popup=_POPUP)
    beside = split.column()
    row = beside.row(align=True)
    row.prop(settings, "ntm", text="")
    row.operator("tvbrdf.find_model", text="", icon="VIEWZOOM")
    card = properties.card_of(settings)
    place, share = (layout, 1.0) if is_narrow(context) else (beside, 1 - _BESIDE)
    if said := suiting.doubt(material):
        paragraph(place, context, said, "ERROR", share=share)
    elif card is not None:
        paragraph(place, context, purpose_of(card), share=share)
    else:
        place.prop(settings, "ntm_file", text="")
    mixing.draw(layout, material)


def _draw_action(
    layout: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material
) -> None:
    aged = is_aged(material)
    if aged:
        _draw_aged(layout, context, material)
    row = layout.row()
    row.scale_y = 1.5
    row.operator("tvbrdf.age_material", text="Age Again" if aged else "Age Material")
    # Below the button: what comes and goes must not move it under the mouse.
    if reason := why_not(material, scene_of(context)):
        paragraph(layout, context, reason, "ERROR")
    else:
        _draw_forecast(layout, context, material)


def _draw_aged(
    layout: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material
) -> None:
    column = layout.column(align=True)
    column.use_property_split = True
    if (path := age_path(material)) is not None:
        column.prop(material, path, text="Age", slider=True)
    strengths.draw_shown(column, material)
    outcome = session.outcome()
    if outcome is not None and outcome.next and outcome.material_uid == material.session_uid:
        paragraph(layout, context, outcome.next, "PLAY")
    row = layout.row(align=True)
    row.operator("tvbrdf.revert", icon="LOOP_BACK")
    row.operator("tvbrdf.freeze", text=f"Freeze at {context.scene.frame_current}", icon="FREEZE")
    if said := left_out(material):
        paragraph(layout, context, said, "ERROR")


def _draw_forecast(
    layout: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material
) -> None:
    expected = outlook_of(material, scene_of(context), cold=session.is_cold())
    if expected is None:
        return
    seconds, balanced = expected.estimate.seconds, expected.balanced.seconds
    said = f"About {in_time(seconds)}, {in_bytes(expected.estimate.bytes)}."
    if material.tvbrdf.quality == EXACT and seconds > max(LONG_SECONDS, 2 * balanced):
        texels = expected.size[0] * expected.size[1]
        said += f" Exact models each of {texels:,} texels; Balanced takes {in_time(balanced)}."
    paragraph(layout, context, said, "TIME" if seconds < LONG_SECONDS else "ERROR")
    if expected.why:
        paragraph(layout, context, expected.why, "CAMERA_DATA")
    if is_kept_apart(material) and not is_aged(material):
        paragraph(layout, context, "Save the file to keep its textures beside it.", "INFO")


def _draw_progress(layout: bpy.types.UILayout, run: Run) -> None:
    # In the place of the button, as high as it: a widget that comes to lie under a resting mouse
    # would be drawn in the button's state.
    row = layout.row()
    row.scale_y = 1.5
    row.alignment = "CENTER"
    row.label(text=f"Aging {run.name}")
    column = layout.column(align=True)
    seconds = run.seconds_left if run.turn[1] == 1 else None
    left = "" if seconds is None else f"  {_time_left(seconds)}"
    column.progress(factor=run.progress, type="BAR", text=f"{run.progress:.0%}{left}")
    column.label(text=f"{run.stage}…")
    if run.previewing:
        column.label(text="Play: a preview is shown", icon="PLAY")
    row = layout.row()
    row.enabled = not run.cancel_requested
    row.operator("tvbrdf.cancel", text="Canceling…" if run.cancel_requested else "Cancel", icon="X")


def _draw_outcome(
    layout: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material
) -> None:
    outcome = session.outcome()
    if outcome is None:
        return
    if outcome.material_uid == material.session_uid:
        for sentence in outcome.sentences:
            paragraph(layout, context, sentence, outcome.icon)
    elif not any(other.session_uid == outcome.material_uid for other in bpy.data.materials):
        # It was deleted, or its file closed: there is no other place left to say so.
        for sentence in outcome.sentences:
            paragraph(layout, context, f"{outcome.material_name}: {sentence}", outcome.icon)
