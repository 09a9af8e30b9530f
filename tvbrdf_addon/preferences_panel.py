"""The preferences as they are shown: set once, for all files."""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ..model_runtime.contract import CACHE_GIGABYTES, IDLE_MINUTES, NEEDS_TORCH
from . import help, keeping, session, tidying
from .launch import Launch
from .models import models_in
from .preferences import EXTENSION, launch, model_folders

__all__ = ("CLASSES",)

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
        help.draw_manual(layout)


def _runtime(how: Launch) -> Sequence[str]:
    """What computes, in the artist's words."""
    if how.interpreter:
        with_what = ("It computes with the libraries of that Python.",)
    elif how.has_torch:
        with_what = (f"It computes with PyTorch {how.torch_version}".rstrip() + ".",)
    else:
        with_what = ("It computes with NumPy: materials age as with PyTorch.", *NEEDS_TORCH)
    return (session.worker_in_words(), *with_what)


CLASSES = (TVBRDF_AP_preferences, *tidying.CLASSES, *keeping.CLASSES)
