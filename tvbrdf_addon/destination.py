"""Which folder a material's textures are written to."""

from __future__ import annotations

import os
import re
import time
from pathlib import Path

import bpy

from . import output, preferences
from .errors import SettingsError

__all__ = ("folder_for", "is_kept_apart", "require_place")

_FILE_NAME = re.compile(r"[^/\\]*$" if os.sep == "\\" else "[^/]*$")


def is_kept_apart(material: bpy.types.Material) -> bool:
    """Whether the textures of `material` are to lie beside a .blend that is not saved yet, and so
    are kept where Blender keeps its settings.
    """
    return material.tvbrdf.output.startswith("//") and not bpy.data.filepath


def require_place(material: bpy.types.Material) -> None:
    """Raises `SettingsError` where there is no place for its textures.  Cheap enough to draw."""
    if not material.tvbrdf.output:
        raise SettingsError("There is no output folder.", "Choose one.")
    if is_kept_apart(material) and preferences.kept_apart() is None:
        raise SettingsError(
            "This file is not saved yet, so its folder is unknown.",
            "Save it, or choose an absolute output folder.",
        )


def folder_for(material: bpy.types.Material) -> Path:
    """A folder for the textures of `material` that no other shows files of.

    Raises:
        SettingsError: there is none that can be written to.
    """
    parent = output.folder_meant(material.tvbrdf.output, _beside())
    folder = output.free_folder(parent, material.name, _folders_in_use(material))
    output.require_writable(folder)
    return folder


def _beside() -> str:
    """What `//` is: the folder of the .blend, or of one that has none a new one each time, as
    other files may show what lies in an older one.
    """
    if bpy.data.filepath or (kept := preferences.kept_apart()) is None:
        return bpy.path.abspath("//")
    return str(kept / time.strftime("%Y-%m-%d %H.%M.%S"))


def _folders_in_use(material: bpy.types.Material) -> set[str]:
    """The folders of all images, and those that other materials' results were written to.

    This material's own textures count: an undo must find them as they were.  Nothing is looked at
    on disk, as there may be thousands.
    """
    # By what is written first: most of a folder are written alike.
    folders = {
        (_FILE_NAME.sub("", image.filepath), image.library)
        for image in bpy.data.images
        if image.filepath
    }
    folders |= {
        (f"{folder.rstrip('/')}/", other.library)
        for other in bpy.data.materials
        if other != material and (folder := other.tvbrdf.folder)
    }
    return {bpy.path.abspath(path, library=library) for path, library in folders}
