"""The .blend that is aged, and the one that is written at the end."""

from __future__ import annotations

import sys
from itertools import takewhile
from pathlib import Path

import bpy

from ..errors import SettingsError

__all__ = ("file_path", "require_file", "require_place", "save")


def file_path(path: str) -> str:
    """`path` as Blender takes it, whole where it is not beside the .blend."""
    # `//` means beside the .blend; anything else is the shell's.
    return path if path.startswith("//") else str(Path(path).absolute())


def require_file() -> None:
    """Raise SettingsError where Blender could not open the .blend that it was given: it goes on
    with the one that it starts with.
    """
    before = takewhile(lambda word: word not in ("-c", "--command"), sys.argv[1:])
    named = [word for word in before if word.endswith(".blend")]
    if named and not bpy.data.filepath:
        raise SettingsError(f"{named[-1]} was not opened.", "See what Blender says of it above.")


def require_place(save_as: str | None) -> None:
    """Raise SettingsError where `--save-as` is bound to fail, before an hour is spent on it."""
    if save_as is None:
        return
    path = Path(bpy.path.abspath(file_path(save_as)))
    if save_as.startswith("//") and not bpy.data.filepath:
        raise SettingsError("No file is open, so // leads nowhere.", "Give --save-as a whole path.")
    if not path.parent.is_dir():
        raise SettingsError(f"There is no folder {path.parent} to save in.", "Make it first.")
    if path.exists() and not path.is_file():  # Blender replaces even a device
        raise SettingsError(f"{path} is no file.", "Name the .blend to save.")


def save(save_as: str | None) -> str:
    """Write the file that is open to `--save-as`, where that is given; its path, or nothing.

    Raises:
        SettingsError: it cannot be written.
    """
    if save_as is None:
        return ""
    path = bpy.path.abspath(file_path(save_as))
    try:
        # Remapped, so that the textures are found from wherever it is saved.
        bpy.ops.wm.save_as_mainfile(filepath=path, relative_remap=True, check_existing=False)
    except RuntimeError as error:
        raise SettingsError(f"{path} cannot be written: {error}".strip()) from error
    return path
