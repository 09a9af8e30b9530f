"""The same panel, and those below it, in two places: the Shader Editor's sidebar and the Material
properties.
"""

from __future__ import annotations

from typing import ClassVar

import bpy

from ..model_runtime.contract import AUTO, EXACT
from . import age_panel, exposure, learn_panel, lights, look, masks, properties, session, strengths
from .drawing import guarded, is_narrow, paragraph
from .help import draw_question_mark
from .known import known, scene_of
from .material.nodes.record import is_aged, is_live
from .material.reading.chosen import object_with
from .material.reading.onset import is_invertible
from .material.result import result_folder
from .operators import material_of
from .presets import TVBRDF_PT_presets
from .sentences import report_in

__all__ = ("CLASSES", "register", "unregister")


@guarded
def _draw_settings(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    material = known(material_of(context))
    layout.use_property_split = True
    layout.use_property_decorate = False
    layout.enabled = session.current() is None and material.library is None
    _draw_range(layout, context, material)
    _draw_detail(layout, material)


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


@guarded
def _draw_start(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    material = known(material_of(context))
    layout.use_property_split = True
    layout.use_property_decorate = False
    layout.enabled = session.current() is None and material.library is None
    layout.prop(material.tvbrdf, "onset")
    if material.tvbrdf.onset == AUTO:
        card = properties.card_of(material.tvbrdf)
        lights.draw(layout, material.tvbrdf, card)
        exposure.draw(layout, material.tvbrdf, spreads=not lights.counts(material.tvbrdf, card))
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
    card = properties.card_of(settings)
    strengths.draw(column, material, card)
    column.prop(settings, "binding")
    column.prop(settings, "format")
    box = column.box()
    paragraph(box, context, properties.SHOWN[settings.format].told.meaning)
    if card is not None:
        box = layout.box()
        paragraph(box, context, f"{card.title}: {card.summary}")
        for source in card.details.get("sources", ()):
            paragraph(box, context, "From {name}: {credit} ({license}).".format_map(source))


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


@guarded
def _draw_result(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    material = known(material_of(context))
    settings, folder = material.tvbrdf, result_folder(material)
    if is_live(material):
        layout.operator("tvbrdf.bake_frames", icon="RENDER_ANIMATION")
    report = report_in(folder) if folder is not None else None
    if report is None:
        return
    card = properties.card_named(report.ntm)
    usual = properties.usual_model(card) if card is not None else None
    for sentence in filter(None, (report.change(usual), *report.sentences, settings.size_reason)):
        paragraph(layout, context, sentence, "DOT")
    outcome = session.outcome()
    said = outcome.sentences if outcome and outcome.material_uid == material.session_uid else ()
    for sentence in report.warnings:
        if sentence not in said:
            paragraph(layout, context, sentence, "ERROR")


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


class _OfMaterial:
    """A part of the panel that there is where there is a material; closed at first."""

    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return material_of(context) is not None


class _Age:
    bl_label = "Age Material"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        if not is_narrow(context):
            draw_question_mark(known(self.layout))
        if material_of(context) is not None:
            TVBRDF_PT_presets.draw_panel_header(known(self.layout))

    def draw(self, context: bpy.types.Context) -> None:
        age_panel.draw(known(self.layout), context)


class _Start(_OfMaterial):
    bl_label = "Where It Starts"

    def draw(self, context: bpy.types.Context) -> None:
        _draw_start(known(self.layout), context)


class _Settings(_OfMaterial):
    bl_label = "Time and Size"

    def draw(self, context: bpy.types.Context) -> None:
        _draw_settings(known(self.layout), context)


class _Advanced(_OfMaterial):
    bl_label = "Advanced"

    def draw(self, context: bpy.types.Context) -> None:
        _draw_advanced(known(self.layout), context)


class _Learn(_OfMaterial):
    bl_label = "Learn from Material"

    def draw(self, context: bpy.types.Context) -> None:
        learn_panel.draw(known(self.layout), context)


class _Result(_OfMaterial):
    bl_label = "Result"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        material = material_of(context)
        return material is not None and is_aged(material)

    def draw(self, context: bpy.types.Context) -> None:
        _draw_result(known(self.layout), context)


class NODE_PT_tvbrdf_age(_Age, _SidebarPanel, bpy.types.Panel):
    pass


class MATERIAL_PT_tvbrdf_age(_Age, _PropertiesPanel, bpy.types.Panel):
    pass


class NODE_PT_tvbrdf_result(_Result, _SidebarPanel, bpy.types.Panel):
    bl_parent_id = "NODE_PT_tvbrdf_age"


class NODE_PT_tvbrdf_start(_Start, _SidebarPanel, bpy.types.Panel):
    bl_parent_id = "NODE_PT_tvbrdf_age"


class NODE_PT_tvbrdf_settings(_Settings, _SidebarPanel, bpy.types.Panel):
    bl_parent_id = "NODE_PT_tvbrdf_age"


class NODE_PT_tvbrdf_advanced(_Advanced, _SidebarPanel, bpy.types.Panel):
    bl_parent_id = "NODE_PT_tvbrdf_age"


class NODE_PT_tvbrdf_learn(_Learn, _SidebarPanel, bpy.types.Panel):
    bl_parent_id = "NODE_PT_tvbrdf_age"


class MATERIAL_PT_tvbrdf_result(_Result, _PropertiesPanel, bpy.types.Panel):
    bl_parent_id = "MATERIAL_PT_tvbrdf_age"


class MATERIAL_PT_tvbrdf_start(_Start, _PropertiesPanel, bpy.types.Panel):
    bl_parent_id = "MATERIAL_PT_tvbrdf_age"


class MATERIAL_PT_tvbrdf_settings(_Settings, _PropertiesPanel, bpy.types.Panel):
    bl_parent_id = "MATERIAL_PT_tvbrdf_age"


class MATERIAL_PT_tvbrdf_advanced(_Advanced, _PropertiesPanel, bpy.types.Panel):
    bl_parent_id = "MATERIAL_PT_tvbrdf_age"


class MATERIAL_PT_tvbrdf_learn(_Learn, _PropertiesPanel, bpy.types.Panel):
    bl_parent_id = "MATERIAL_PT_tvbrdf_age"


class PROPERTIES_PT_tvbrdf_drop_down(bpy.types.Panel):
    bl_label = "Age Material"
    bl_space_type = "PROPERTIES"
    bl_region_type = "HEADER"  # drawn nowhere of itself
    bl_ui_units_x = 12

    def draw(self, context: bpy.types.Context) -> None:
        age_panel.draw(known(self.layout), context)


CLASSES = (
    PROPERTIES_PT_tvbrdf_drop_down,
    NODE_PT_tvbrdf_age,
    NODE_PT_tvbrdf_result,
    NODE_PT_tvbrdf_start,
    NODE_PT_tvbrdf_settings,
    NODE_PT_tvbrdf_advanced,
    NODE_PT_tvbrdf_learn,
    MATERIAL_PT_tvbrdf_age,
    MATERIAL_PT_tvbrdf_result,
    MATERIAL_PT_tvbrdf_start,
    MATERIAL_PT_tvbrdf_settings,
    MATERIAL_PT_tvbrdf_advanced,
    MATERIAL_PT_tvbrdf_learn,
)


_SLOTS = ("EEVEE_MATERIAL_PT_context_material", "CYCLES_PT_context_material")
"""Panels with a material's slots, a render engine each: at the top, and always open."""


def _draw_below_slots(self: bpy.types.Panel, context: bpy.types.Context) -> None:
    age_panel.draw_row(known(self.layout), context)


def register() -> None:
    for name in _SLOTS:
        if (panel := getattr(bpy.types, name, None)) is not None:
            panel.append(_draw_below_slots)


def unregister() -> None:
    for name in _SLOTS:
        if (panel := getattr(bpy.types, name, None)) is not None:
            panel.remove(_draw_below_slots)
