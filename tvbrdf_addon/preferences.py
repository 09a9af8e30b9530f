"""Where the worker's Python and further models are; set once, for all files."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import bpy

from ..model_runtime.contract import CACHE_GIGABYTES, IDLE_MINUTES, NEEDS_TORCH
from ..model_runtime.model_files import weights
from . import keeping, tidying
from .launch import Launch
from .models import models_in

__all__ = ("CLASSES", "kept_apart", "launch", "model_folders", "models_folder", "user_file")

# The extension's own module, `bl_ext.<repository>.tvbrdf`.
EXTENSION = __package__.rpartition(".")[0]
# About files in the models folder that are left out.
MOST_SENTENCES = 5


class TVBRDF_AP_preferences(bpy.types.AddonPreferences):
    bl_idname = EXTENSION

    models_folder: bpy.props.StringProperty(
        name="Models Folder",
        description=(
            "Folder with models (.safetensors) of your own: they appear in the model list, and "
            "what you let materials teach is put there"
        ),
        subtype="DIR_PATH",
    )
    worker_python: bpy.props.StringProperty(
        name="Worker Python",
        description=(
            "Python that computes the aging, for instance one with a GPU build of torch. "
            "It needs numpy, OpenEXR, safetensors and Pillow, and torch to learn. A whole path, "
            "not one that is relative to the .blend. Empty: the one that came with the extension"
        ),
        subtype="FILE_PATH",
    )
    idle_minutes: bpy.props.IntProperty(
        name="Keep Ready",
        description=(
            "Minutes for which the worker waits for a next run before it gives its memory back"
        ),
        default=int(IDLE_MINUTES),
        min=1,
        max=7 * 24 * 60,
        soft_max=60,
    )
    keep_gigabytes: bpy.props.FloatProperty(
        name="Keep Results",
        description=(
            "Gigabytes of results that are kept apart from all files: aging the same material by "
            "the same settings again, here or in another file, takes no time. 0 keeps none"
        ),
        default=CACHE_GIGABYTES,
        min=0.0,
        soft_max=50.0,
        precision=1,
    )

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(self, "models_folder", placeholder="With the settings of Blender")
        left_out = models_in(model_folders()).left_out
        for sentence in left_out[:MOST_SENTENCES]:
            layout.label(text=sentence, icon="ERROR")
        if len(left_out) > MOST_SENTENCES:
            layout.label(text=f"{len(left_out) - MOST_SENTENCES} more files are no models.")
        layout.prop(self, "worker_python", placeholder="Comes with the extension")
        layout.prop(self, "idle_minutes", text="Keep Ready (Minutes)")
        layout.prop(self, "keep_gigabytes", text="Keep Results (GB)")
        column = layout.column(align=True)
        for number, sentence in enumerate(_runtime(launch())):
            column.label(text=sentence, icon="BLANK1" if number else "INFO")
        tidying.draw(layout)
        keeping.draw(layout, launch().cache_folder)


def _runtime(how: Launch) -> Sequence[str]:
    """What computes, in the artist's words."""
    if how.interpreter:
        return ("Computes with the libraries of that Python.",)
    if how.has_torch:
        return ("Computes with PyTorch.",)
    return ("Computes with NumPy: materials age as they do with PyTorch.", *NEEDS_TORCH)


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


def _preferences() -> TVBRDF_AP_preferences | None:
    # None where the extension is registered without being installed, as in tests.
    addon = bpy.context.preferences.addons.get(EXTENSION)
    return addon.preferences if addon is not None else None


CLASSES = (TVBRDF_AP_preferences, *tidying.CLASSES, *keeping.CLASSES)
