"""What is this: a few sentences behind a question mark, and the manual in the browser."""

from __future__ import annotations

from typing import ClassVar

import bpy

from ..model_runtime.model_files import weights
from .drawing import lines
from .known import known

__all__ = ("CLASSES", "draw_manual", "draw_question_mark")

# Of the page that the zip brings (.ci/manual.py); a working tree has none.
_MANUAL = weights.MODELS.parents[1] / "manual" / "manual.html"
_WIDTH = 17  # in heights of a button, of 20 pixels
_LINE = 20 * _WIDTH - 30
_WHAT = "Years pass for this material: it rusts, grows moss, peels, fades, as you choose."
_STEPS = (
    "Click the picture to choose what happens.",
    "Click Age Material. It takes some seconds; Blender stays usable, and Esc cancels.",
    "Look at it in Material Preview or Rendered: Solid shows no materials.",
    "Drag Age, or play. It is keyed over the frames; its keys lie on the material.",
    "Revert brings your material back, exactly.",
)


class TVBRDF_OT_manual(bpy.types.Operator):
    """Open the manual that came with the extension in your web browser; nothing is downloaded"""

    bl_idname = "tvbrdf.manual"
    bl_label = "Manual"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if not _MANUAL.is_file():
            cls.poll_message_set("It comes with the zip of the extension")
            return False
        return True

    def execute(self, _context: bpy.types.Context) -> set[str]:
        bpy.ops.wm.url_open(url=_MANUAL.as_uri())
        return {"FINISHED"}


class TVBRDF_PT_help(bpy.types.Panel):
    """What this does, and how"""

    bl_label = "What Is This?"
    bl_space_type = "PROPERTIES"
    bl_region_type = "HEADER"  # drawn nowhere of itself
    bl_ui_units_x = _WIDTH

    def draw(self, _context: bpy.types.Context) -> None:
        layout = known(self.layout)
        layout.label(text=self.bl_label)
        lines(layout, _WHAT, _LINE)
        for number, step in enumerate(_STEPS, 1):
            lines(layout, f"{number}.  {step}", _LINE)
        draw_manual(layout)


def draw_manual(layout: bpy.types.UILayout) -> None:
    layout.operator("tvbrdf.manual", icon="HELP")


def draw_question_mark(layout: bpy.types.UILayout) -> None:
    row = layout.row()
    row.emboss = "NONE"
    row.popover("TVBRDF_PT_help", text="", icon="QUESTION")


CLASSES = (TVBRDF_OT_manual, TVBRDF_PT_help)
