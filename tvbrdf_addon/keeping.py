"""Results that are kept so that the same is not aged twice: how much disk they take, and away."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import bpy

from ..model_runtime.output.kept import Kept
from .estimate import in_bytes

__all__ = ("CLASSES", "draw")


def draw(layout: bpy.types.UILayout, folder: Path | None) -> None:
    """What is kept in `folder`; nothing where that is nothing."""
    size = Kept(folder, 0).size() if folder is not None else 0
    if not size:
        return
    row = layout.row(align=True)
    row.label(text=f"Results kept for the next time take {in_bytes(size)}.")
    row.operator("tvbrdf.clear_kept", icon="TRASH").folder = str(folder)


class TVBRDF_OT_clear_kept(bpy.types.Operator):
    """Delete the results kept for the next time. What materials show lies elsewhere and stays"""

    bl_idname = "tvbrdf.clear_kept"
    bl_label = "Clear"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    folder: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    def execute(self, _context: bpy.types.Context) -> set[str]:
        if not self.folder:
            return {"CANCELLED"}
        kept = Kept(Path(self.folder), 0)
        before = kept.size()
        kept.clear()
        self.report({"INFO"}, f"{in_bytes(before - kept.size())} of kept results are deleted")
        return {"FINISHED"}


CLASSES = (TVBRDF_OT_clear_kept,)
