"""Finding a model by words: what it is called, and what it is for."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from . import preferences, suiting
from .known import known
from .models import Item, models_in, purpose_of
from .operators import material_of

__all__ = ("CLASSES",)

# Blender keeps pointers to the strings of a dynamic enum without owning them, so they live here.
_items: list[Item] = []


def _found(_self: Any, context: bpy.types.Context | None) -> list[Item]:
    """The models that a material can get, each with what it is for in its name."""
    global _items
    cards = models_in(preferences.model_folders()).cards
    items = [
        (name, f"{title}: {purpose_of(cards[name])}" if name in cards else title, *rest)
        for name, title, *rest in suiting.models_for(material_of(known(context)))
    ]
    if items != _items:
        _items = items
    return _items


class TVBRDF_OT_find_model(bpy.types.Operator):
    """Find a model by what it does or what it is for"""

    bl_idname = "tvbrdf.find_model"
    bl_label = "Find Model"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    bl_property = "model"

    model: bpy.props.EnumProperty(
        name="Model", description="What is to happen to the material", items=_found
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        material = material_of(context)
        if material is None or material.library is not None:
            cls.poll_message_set("There is no material that can be changed")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        material = material_of(context)
        assert material is not None
        material.tvbrdf.ntm = self.model
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.invoke_search_popup(self)
        return {"FINISHED"}


CLASSES = (TVBRDF_OT_find_model,)
