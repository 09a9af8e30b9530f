"""Where results are written.  No bpy."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

from ..model_runtime.output.commit import is_free
from .errors import SettingsError

__all__ = ("file_safe", "folder_meant", "free_folder", "require_writable")

# Names that Windows keeps for devices, whatever their extension.
RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")
LONGEST_BYTES = 120


def file_safe(name: str) -> str:
    """`name` as a folder name that every system accepts; other scripts' letters stay."""
    safe = _trimmed(re.sub(r'[<>:"/\\|?*\x00-\x1f\x7f-\x9f]', "_", name))
    safe = _trimmed(safe.encode()[:LONGEST_BYTES].decode(errors="ignore"))
    if safe.startswith("."):
        safe = "_" + safe[1:]
    if not safe:
        return "material"
    return f"_{safe}" if RESERVED.fullmatch(safe) else safe


def _trimmed(name: str) -> str:
    """`name` without spaces at its ends and dots at its end, of whatever script."""
    return re.sub(r"^\s+|[\s.]+$", "", name)


def free_folder(parent: Path, name: str, taken: Iterable[str | Path]) -> Path:
    """The first of `name`, `name.001`, ... in `parent` that may be written to.

    A folder may not where a material shows files of it (`taken`), nor where it holds something
    that is not an earlier result.

    Raises:
        SettingsError: `parent` cannot be looked into.
    """
    parents: dict[str, str] = {}
    refused = {_key(str(folder), parents) for folder in taken}
    safe = file_safe(name)
    number = 0
    while True:
        folder = parent / (f"{safe}.{number:03d}" if number else safe)
        try:
            if _key(str(folder), parents) not in refused and is_free(folder):
                return folder
        except (OSError, ValueError) as error:
            raise _unusable(folder, error) from error
        number += 1


def folder_meant(text: str, beside: str) -> Path:
    """The folder that a setting names: `//` is the folder `beside`, that of the .blend.

    Where a file that was made on Windows is opened elsewhere, the folders of `//tex\\aged\\` are
    still folders.

    Raises:
        SettingsError: it is on a drive of Windows, and this is another system.
    """
    if os.name != "nt":
        if re.match(r"[A-Za-z]:[\\/]|\\\\", text):
            raise SettingsError(
                f"The output folder {text} is on a drive of Windows, which this machine has not.",
                "Choose another, or one beside the .blend (//).",
            )
        if text.startswith("//"):
            text = text.replace("\\", "/")
    if text.startswith("//"):
        return Path(beside, text.lstrip("/")).absolute()
    return Path(text).absolute()


def require_writable(folder: Path) -> None:
    """Raise SettingsError where `folder` can be neither written to nor made."""
    existing = folder
    try:
        while not existing.exists() and existing != existing.parent:
            existing = existing.parent
    except (OSError, ValueError) as error:
        raise _unusable(folder, error) from error
    if not existing.is_dir():
        raise SettingsError(f"{existing} is a file, not a folder.", "Choose another output folder.")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise SettingsError(
            f"The output folder {existing} cannot be written to.", "Choose another output folder."
        )


def _unusable(folder: Path, error: OSError | ValueError) -> SettingsError:
    reason = error.strerror if isinstance(error, OSError) else error
    return SettingsError(
        f"The output folder {folder} cannot be used ({reason}).", "Choose another output folder."
    )


def _key(folder: str, parents: dict[str, str]) -> str:
    """What is the same for folders that are one, however they are reached; `parents` are those that
    were found already, as thousands of folders may lie in a few.
    """
    parent, name = os.path.split(os.path.normpath(folder))
    if parent not in parents:
        parents[parent] = os.path.realpath(parent)
    path = f"{parents[parent]}{os.sep}{name}"
    real = os.path.realpath(path) if name == ".." or os.path.islink(path) else path  # noqa: PTH114
    # Steel and steel are one folder on most artists' machines.
    return real.casefold()
