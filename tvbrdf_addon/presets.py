"""Settings that are kept for later, as Blender keeps presets, or copied to other materials."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from .ageing import materials_of_selected
from .known import known
from .operators import material_of

__all__ = ("CLASSES", "TVBRDF_PT_presets")

# What belongs to one material, object or file.
_OWN = ("rna_type", "name", "output", "starts", "onset_image", "onset_attribute")
_OWN_MASK = ("mask_source", "mask_image", "mask_attribute")


def _settable(settings: Any, *, own: bool) -> Iterator[str]:
    """The names of the settings that an artist sets, in an order in which none changes another that
    came before; with `own` those of one object or file, too.
    """
    left = (*_OWN[:2], *(() if own else (*_OWN[2:], *_OWN_MASK)))
    shown = [p for p in settings.bl_rna.properties if not p.is_hidden and p.identifier not in left]
    # Some numbers switch a check box when they are set, and one box sets the sliders of a group.
    for prop in sorted(shown, key=lambda each: (each.type == "POINTER", each.type == "BOOLEAN")):
        value = getattr(settings, prop.identifier)
        if isinstance(value, bpy.types.PropertyGroup):
            yield from (f"{prop.identifier}.{name}" for name in _settable(value, own=own))
        else:
            yield prop.identifier


def copy_settings(source: bpy.types.Material, target: bpy.types.Material) -> None:
    """Gives `target` the settings that `source` is aged with."""
    for path in _settable(source.tvbrdf, own=True):
        group, _, name = path.rpartition(".")
        of = [getattr(each.tvbrdf, group) if group else each.tvbrdf for each in (source, target)]
        setattr(of[1], name, getattr(of[0], name))


class TVBRDF_OT_copy_settings(bpy.types.Operator):
    """Give the other materials of the selected objects the settings of this one"""

    bl_idname = "tvbrdf.copy_settings"
    bl_label = "Copy Aging Settings to Selected"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if material_of(context) is None or not _others(context):
            cls.poll_message_set("Select an object with another material")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        others = _others(context)
        for other in others:
            copy_settings(known(material_of(context)), other)
        self.report({"INFO"}, f"{len(others)} materials have these settings now")
        return {"FINISHED"}


def _others(context: bpy.types.Context) -> list[bpy.types.Material]:
    source = material_of(context)
    found = materials_of_selected(context)
    return [each for each in found if each != source and each.library is None]


class TVBRDF_PT_presets(PresetPanel, bpy.types.Panel):
    bl_label = "Aging Presets"
    preset_subdir = "tvbrdf"
    preset_operator = "script.execute_preset"
    preset_add_operator = "tvbrdf.add_preset"


class TVBRDF_OT_add_preset(AddPresetBase, bpy.types.Operator):
    """Keep these settings, or forget the chosen ones"""

    bl_idname = "tvbrdf.add_preset"
    bl_label = "Add Aging Preset"
    preset_menu = "TVBRDF_PT_presets"
    preset_subdir = "tvbrdf"
    preset_defines: ClassVar[list[str]] = [
        "material = getattr(bpy.context, 'material', None) or bpy.context.object.active_material",
        "settings = material.tvbrdf",
    ]

    @property
    def preset_values(self) -> list[str]:
        settings = known(material_of(bpy.context)).tvbrdf
        return [f"settings.{name}" for name in _settable(settings, own=False)]


CLASSES = (TVBRDF_OT_copy_settings, TVBRDF_PT_presets, TVBRDF_OT_add_preset)
