"""Which Principled BSDF ages, where a surface mixes several."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from .errors import MaterialError, SettingsError
from .known import known
from .material.nodes.surface import Place, find_principled
from .operators import OnMaterial, material_of

__all__ = ("CLASSES", "draw")

# Blender keeps pointers to the strings of a dynamic enum without owning them, so they live here.
_items: list[tuple[str, str, str]] = []


def _places(material: bpy.types.Material | None) -> list[Place]:
    """The one that ages and those beside it; none where there is none that can."""
    if material is None or material.node_tree is None:
        return []
    try:
        place = find_principled(material)
    except MaterialError:
        return []
    return [place, *place.beside]


def draw(layout: bpy.types.UILayout, material: bpy.types.Material) -> None:
    """A menu of them, where there is a choice."""
    places = _places(material)
    if len(places) > 1:
        layout.operator_menu_enum(
            "tvbrdf.choose_shader", "path", text=f"Ages {places[0].name}", icon="NODE_MATERIAL"
        )


def _choices(_self: Any, context: bpy.types.Context | None) -> list[tuple[str, str, str]]:
    global _items
    places = sorted(_places(material_of(known(context))), key=lambda place: place.path)
    items = [(place.path, place.name, "") for place in places]
    if items != _items:
        _items = items
    return _items


class TVBRDF_OT_choose_shader(OnMaterial, bpy.types.Operator):
    """Choose which of the Principled BSDFs ages that the surface mixes"""

    bl_idname = "tvbrdf.choose_shader"
    bl_label = "Choose What Ages"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    path: bpy.props.EnumProperty(
        name="Shader", description="The Principled BSDF that ages", items=_choices
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self.target(context).material.tvbrdf.shader = self.path
        except SettingsError as error:
            return self.refuse(error)
        return {"FINISHED"}


CLASSES = (TVBRDF_OT_choose_shader,)
