"""Where the worker's Python and further models are, as the user's preferences say."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from ..model_runtime.contract import CACHE_GIGABYTES, IDLE_MINUTES
from ..model_runtime.model_files import weights
from .launch import Launch

__all__ = ("EXTENSION", "kept_apart", "launch", "model_folders", "models_folder", "user_file")

EXTENSION = __package__.rpartition(".")[0]
"""The extension's own module, `bl_ext.<repository>.tvbrdf`."""


def model_folders() -> Sequence[Path]:
    """The folders whose models can be chosen: the bundled one, and the user's."""
    own, preferences = models_folder(), _preferences()
    chosen = preferences is not None and preferences.models_folder
    # One that nobody chose comes to be with what is first put there.
    return (weights.MODELS, own) if own and (chosen or own.is_dir()) else (weights.MODELS,)


def models_folder() -> Path | None:
    """The user's folder of models: the one chosen, else one that outlives updates of the extension;
    None where there is no place for one.
    """
    preferences = _preferences()
    if preferences is not None and preferences.models_folder:
        return Path(bpy.path.abspath(preferences.models_folder))
    return user_file("models")


def kept_apart() -> Path | None:
    """Where textures lie of files that are not saved yet; None where there is no place for them."""
    return user_file("aged")


def launch() -> Launch:
    """How the worker is started, after the preferences."""
    extensions = Path(bpy.utils.user_resource("EXTENSIONS"))
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    preferences = _preferences()
    return Launch(
        runtime=weights.MODELS.parents[1],
        site_packages=(extensions / ".local" / "lib" / python / "site-packages",),
        interpreter=preferences.worker_python if preferences else "",
        idle_minutes=preferences.idle_minutes if preferences else IDLE_MINUTES,
        cache=user_file("cache"),
        cache_gigabytes=preferences.keep_gigabytes if preferences else CACHE_GIGABYTES,
    )


def user_file(name: str) -> Path | None:
    """A file that outlives updates of the extension; None where there is no place for one."""
    try:
        folder = bpy.utils.extension_path_user(EXTENSION, create=True)
    except ValueError:  # registered without being installed, as in tests
        return None
    return Path(folder) / name if folder else None


def _preferences() -> Any:
    # None where the extension is registered without being installed, as in tests.
    addon = bpy.context.preferences.addons.get(EXTENSION)
    return addon.preferences if addon is not None else None
