"""Results that nothing in this file shows any more: how much disk they take, and away with them."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import ClassVar

import bpy

from ..model_runtime.contract import REPORT, is_result_file
from . import output, preferences
from .errors import SettingsError
from .estimate import in_bytes
from .material.result import result_folder

__all__ = ("CLASSES", "draw", "left_over")


def _results() -> set[Path]:
    """The folders of results of this file's materials, and those that lie beside them."""
    shown = _shown()
    parents = {folder.parent for folder in shown}
    if bpy.data.filepath:
        for material in bpy.data.materials:
            if material.tvbrdf.output:
                parents.add(_meant(material.tvbrdf.output))
    found = {each for parent in parents if parent.is_dir() for each in parent.iterdir()}
    return {each for each in found if (each / REPORT).is_file()} | shown


def _shown() -> set[Path]:
    """The folders of results that materials and images of this file show."""
    of_materials = (result_folder(material) for material in bpy.data.materials)
    of_images = (
        Path(bpy.path.abspath(image.filepath, library=image.library)).parent
        for image in bpy.data.images
        if image.filepath
    )
    folders = {each.resolve() for each in (*of_materials, *of_images) if each is not None}
    return {each for each in folders if (each / REPORT).is_file()}


def _meant(text: str) -> Path:
    try:
        return output.folder_meant(text, bpy.path.abspath("//")).resolve()
    except SettingsError:
        return Path()


def left_over() -> list[Path]:
    """The folders beside those of this file's materials that hold a result that none of these
    shows, and nothing else.

    Not those of files that were not saved then: any file, saved since or elsewhere, may show them.
    """
    apart = preferences.kept_apart()
    left = _results() - _shown()
    if apart is not None:
        left = {each for each in left if not each.is_relative_to(apart.resolve())}
    return sorted(each for each in left if _holds_nothing_else(each))


def _holds_nothing_else(folder: Path) -> bool:
    names = {each.name for each in folder.iterdir()}
    return all(name == REPORT or is_result_file(name) for name in names)


def _bytes_in(folders: Iterable[Path]) -> int:
    files = (file for folder in folders for file in folder.iterdir() if file.is_file())
    return sum(file.stat().st_size for file in files)


def draw(layout: bpy.types.UILayout) -> None:
    if results := _results():
        row = layout.row(align=True)
        row.label(text=f"Aged materials here ({len(results)}): {in_bytes(_bytes_in(results))}.")
        row.operator("tvbrdf.clean_up", icon="TRASH")
    apart = preferences.kept_apart()
    if apart is not None and (kept := {report.parent for report in apart.rglob(REPORT)}):
        row = layout.row(align=True)
        row.label(text=f"Aged in unsaved files ({len(kept)}): {in_bytes(_bytes_in(kept))}.")
        row.operator("wm.path_open", text="Open Folder", icon="FILE_FOLDER").filepath = str(apart)


class TVBRDF_OT_clean_up(bpy.types.Operator):
    """Delete the textures beside those of this file that no material of it shows any more"""

    bl_idname = "tvbrdf.clean_up"
    bl_label = "Clean Up"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if not left_over():
            cls.poll_message_set("Every aged material that is kept is shown")
            return False
        return True

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        folders = left_over()
        named = ", ".join(folder.name for folder in folders[:5])
        more = ", ..." if len(folders) > 5 else ""
        return context.window_manager.invoke_confirm(
            self,
            event,
            title=f"Delete {in_bytes(_bytes_in(folders))}?",
            message=f"{named}{more}: other files may show them, and Undo brings none back.",
            confirm_text="Delete",
        )

    def execute(self, _context: bpy.types.Context) -> set[str]:
        folders = left_over()
        for folder in folders:
            shutil.rmtree(folder, ignore_errors=True)
        kept = [folder for folder in folders if folder.exists()]
        if kept:
            self.report({"WARNING"}, f"{kept[0]} cannot be deleted: is a file of it open?")
        self.report({"INFO"}, f"{len(folders) - len(kept)} aged materials are deleted")
        return {"FINISHED"}


CLASSES = (TVBRDF_OT_clean_up,)
