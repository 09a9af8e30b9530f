"""The same panel in two places: the Shader Editor's sidebar and the Material properties."""

from __future__ import annotations

from typing import ClassVar

import bpy

from ..model_runtime.contract import AUTO, EXACT
from . import exposure, learn_panel, look, masks, properties, session, strengths, suiting
from .drawing import guarded, paragraph
from .estimate import in_bytes, in_time
from .known import known, scene_of
from .material.nodes.age import age_path
from .material.nodes.record import is_live
from .material.nodes.revert import is_aged
from .material.reading.chosen import object_with
from .material.reading.onset import is_invertible
from .material.result import result_folder
from .operators import material_of
from .outlook import look_soon, outlook_of
from .rates import LONG_SECONDS
from .run import Run, why_not
from .sentences import report_in
from .sharing import left_out

__all__ = ("CLASSES",)


def _time_left(seconds: float) -> str:
    if seconds < 10:
        return "a few seconds left"
    if seconds < 90:
        return f"about {round(seconds, -1):.0f} s left"
    return f"about {seconds / 60:.0f} min left"


@guarded
def _draw_age(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    material = material_of(context)
    if material is None:
        layout.label(text="Give the object a material to age it.")
        return
    layout.use_property_split = True
    layout.use_property_decorate = False
    run = session.current()
    settings = layout.column()
    settings.enabled = run is None and material.library is None
    _draw_model(settings, context, material)
    _draw_range(settings, context, material)
    _draw_detail(settings, material)
    layout.separator()
    if run is not None:
        _draw_progress(layout, run)
    else:
        _draw_action(layout, context, material)
        _draw_outcome(layout, context, material)
        _draw_report(layout, context, material)


def _draw_model(
    layout: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material
) -> None:
    settings = material.tvbrdf
    layout.prop(settings, "ntm")
    if settings.ntm == properties.OWN_FILE:
        layout.prop(settings, "ntm_file")
    look_soon(material, scene_of(context))
    if said := suiting.doubt(material):
        paragraph(layout, context, said, "ERROR")
    card = properties.card_of(settings)
    if card is not None:
        box = layout.box()
        paragraph(box, context, card.summary)
        for source in card.details.get("sources", ()):
            paragraph(box, context, "From {name}: {credit} ({license}).".format_map(source))
    strengths.draw(layout, material, card)


def _draw_range(
    layout: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material
) -> None:
    settings = material.tvbrdf
    layout.prop(settings, "use_scene_range")
    column = layout.column(align=True)
    if settings.use_scene_range:
        column.enabled = False
        column.prop(context.scene, "frame_start", text="First Frame")
        column.prop(context.scene, "frame_end", text="Last Frame")
    else:
        column.prop(settings, "frame_start")
        column.prop(settings, "frame_end")
    layout.prop(settings, "steps")


def _draw_detail(layout: bpy.types.UILayout, material: bpy.types.Material) -> None:
    settings = material.tvbrdf
    column = layout.column()
    column.prop(settings, "use_camera_size")
    if not settings.use_camera_size:
        column.prop(settings, "size")
    column.prop(settings, "quality")
    column.prop(settings, "output")


def _draw_action(
    layout: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material
) -> None:
    aged = is_aged(material)
    row = layout.row()
    row.scale_y = 1.5
    text = "Age Again from the Original" if aged else "Age Material"
    row.operator("tvbrdf.age_material", text=text)
    # Below the button: what comes and goes must not move it under the mouse.
    if reason := why_not(material, scene_of(context)):
        paragraph(layout, context, reason, "ERROR")
    else:
        _draw_forecast(layout, context, material)
    if aged:
        if (path := age_path(material)) is not None:
            layout.prop(material, path, text="Age", slider=True)
        row = layout.row(align=True)
        row.operator("tvbrdf.revert", icon="LOOP_BACK")
        row.operator(
            "tvbrdf.freeze", text=f"Freeze at {context.scene.frame_current}", icon="FREEZE"
        )
        if is_live(material):
            layout.operator("tvbrdf.bake_frames", icon="RENDER_ANIMATION")
        if said := left_out(material):
            paragraph(layout, context, said, "ERROR")


def _draw_forecast(
    layout: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material
) -> None:
    if (expected := outlook_of(material, scene_of(context))) is None:
        return
    seconds, balanced = expected.estimate.seconds, expected.balanced.seconds
    said = f"About {in_time(seconds)}, {in_bytes(expected.estimate.bytes)}."
    if material.tvbrdf.quality == EXACT and seconds > max(LONG_SECONDS, 2 * balanced):
        texels = expected.size[0] * expected.size[1]
        said += f" Exact models each of {texels:,} texels; Balanced takes {in_time(balanced)}."
    paragraph(layout, context, said, "TIME" if seconds < LONG_SECONDS else "ERROR")
    if expected.why:
        paragraph(layout, context, expected.why, "CAMERA_DATA")


def _draw_progress(layout: bpy.types.UILayout, run: Run) -> None:
    # In the place of the button, as high as it: a widget that comes to lie under a resting mouse
    # would be drawn in the button's state.
    row = layout.row()
    row.scale_y = 1.5
    row.alignment = "CENTER"
    row.label(text=f"Aging {run.plan.material_name}")
    column = layout.column(align=True)
    left = "" if run.seconds_left is None else f"  {_time_left(run.seconds_left)}"
    column.progress(factor=run.fraction, type="BAR", text=f"{run.fraction:.0%}{left}")
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


@guarded
def _draw_start(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    material = known(material_of(context))
    layout.use_property_split = True
    layout.use_property_decorate = False
    layout.enabled = session.current() is None and material.library is None
    layout.prop(material.tvbrdf, "onset")
    if material.tvbrdf.onset == AUTO:
        exposure.draw(layout, material.tvbrdf)
        masks.draw(layout, context, material)
        look.draw(layout, material)
    if is_invertible(material):
        _draw_onset(layout, context, material)


@guarded
def _draw_advanced(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    material = known(material_of(context))
    layout.use_property_split = True
    layout.use_property_decorate = False
    layout.enabled = session.current() is None and material.library is None
    settings = material.tvbrdf
    column = layout.column()
    column.prop(settings, "temporal_model")
    row = column.row()
    row.enabled = settings.quality != EXACT
    row.prop(settings, "tolerance", text="Tolerance (dB)")
    column.prop(settings, "specular")
    column.separator()
    column.prop(settings, "binding")
    column.prop(settings, "format")
    box = column.box()
    paragraph(box, context, properties.SHOWN[settings.format].told.meaning)


def _draw_onset(
    layout: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material
) -> None:
    settings = material.tvbrdf
    obj = object_with(material, scene_of(context))
    if settings.onset == "image":
        layout.template_ID(settings, "onset_image", new="image.new", open="image.open")
    elif obj is not None and obj.type == "MESH":
        layout.prop_search(settings, "onset_attribute", obj.data, "color_attributes")
    else:
        layout.prop(settings, "onset_attribute")
    layout.prop(settings, "onset_invert")
    first, last = ("White", "black") if settings.onset_invert else ("Black", "white")
    paragraph(layout, context, f"{first} starts first, {last} last.", "INFO")


def _draw_report(
    layout: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material
) -> None:
    settings, folder = material.tvbrdf, result_folder(material)
    report = report_in(folder) if folder is not None and is_aged(material) else None
    if report is None:
        return
    header, body = layout.panel("tvbrdf_report", default_closed=True)
    header.label(text="Report")
    if body is None:
        return
    card = properties.card_named(report.ntm)
    usual = properties.usual_model(card) if card is not None else None
    for sentence in filter(None, (report.change(usual), *report.sentences, settings.size_reason)):
        paragraph(body, context, sentence, "DOT")
    outcome = session.outcome()
    said = outcome.sentences if outcome and outcome.material_uid == material.session_uid else ()
    for sentence in report.warnings:
        if sentence not in said:
            paragraph(body, context, sentence, "ERROR")


class _SidebarPanel:
    bl_space_type = "NODE_EDITOR"
    bl_region_type = "UI"
    bl_category = "Age"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        space = context.space_data
        return space.tree_type == "ShaderNodeTree" and space.shader_type == "OBJECT"


class _PropertiesPanel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "material"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.material is not None


class NODE_PT_tvbrdf_age(_SidebarPanel, bpy.types.Panel):
    bl_label = "Age Material"

    def draw(self, context: bpy.types.Context) -> None:
        _draw_age(known(self.layout), context)


class NODE_PT_tvbrdf_start(_SidebarPanel, bpy.types.Panel):
    bl_label = "Where It Starts"
    bl_parent_id = "NODE_PT_tvbrdf_age"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return material_of(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        _draw_start(known(self.layout), context)


class NODE_PT_tvbrdf_advanced(_SidebarPanel, bpy.types.Panel):
    bl_label = "Advanced"
    bl_parent_id = "NODE_PT_tvbrdf_age"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return material_of(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        _draw_advanced(known(self.layout), context)


class NODE_PT_tvbrdf_learn(_SidebarPanel, bpy.types.Panel):
    bl_label = "Learn from Material"
    bl_parent_id = "NODE_PT_tvbrdf_age"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        learn_panel.draw(known(self.layout), context)


class MATERIAL_PT_tvbrdf_age(_PropertiesPanel, bpy.types.Panel):
    bl_label = "Age Material"

    def draw(self, context: bpy.types.Context) -> None:
        _draw_age(known(self.layout), context)


class MATERIAL_PT_tvbrdf_start(_PropertiesPanel, bpy.types.Panel):
    bl_label = "Where It Starts"
    bl_parent_id = "MATERIAL_PT_tvbrdf_age"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        _draw_start(known(self.layout), context)


class MATERIAL_PT_tvbrdf_advanced(_PropertiesPanel, bpy.types.Panel):
    bl_label = "Advanced"
    bl_parent_id = "MATERIAL_PT_tvbrdf_age"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        _draw_advanced(known(self.layout), context)


class MATERIAL_PT_tvbrdf_learn(_PropertiesPanel, bpy.types.Panel):
    bl_label = "Learn from Material"
    bl_parent_id = "MATERIAL_PT_tvbrdf_age"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        learn_panel.draw(known(self.layout), context)


CLASSES = (
    NODE_PT_tvbrdf_age,
    NODE_PT_tvbrdf_start,
    NODE_PT_tvbrdf_advanced,
    NODE_PT_tvbrdf_learn,
    MATERIAL_PT_tvbrdf_age,
    MATERIAL_PT_tvbrdf_start,
    MATERIAL_PT_tvbrdf_advanced,
    MATERIAL_PT_tvbrdf_learn,
)
