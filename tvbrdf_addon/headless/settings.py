"""What was asked for on the command line, kept in a material's settings as the panel keeps it."""

from __future__ import annotations

import argparse
from pathlib import Path

import bpy

from ...model_runtime.contract import AUTO, EVERYWHERE
from ...model_runtime.model_files import weights
from .. import preferences, properties
from ..errors import SettingsError
from ..output import folder_meant
from .parser import ATTRIBUTE
from .saving import file_path

__all__ = ("apply",)


def apply(arguments: argparse.Namespace, material: bpy.types.Material) -> None:
    """Keep what was asked for in the material's settings, as the panel does."""
    settings = material.tvbrdf
    if material.library is not None:
        raise SettingsError(
            f"{material.name} is linked from another file.", "Make it local there first."
        )
    if arguments.ntm.endswith(".safetensors"):
        settings.ntm, settings.ntm_file = properties.OWN_FILE, str(Path(arguments.ntm).absolute())
    else:
        weights.find_model(arguments.ntm, preferences.model_folders())
        settings.ntm = arguments.ntm
    settings.frame_start, settings.frame_end = arguments.frames
    _apply_onset(arguments, settings)
    if arguments.output is not None:
        settings.output = _output(arguments.output)
    if arguments.size == AUTO:
        settings.use_camera_size = True
    elif arguments.size is not None:
        settings.size = arguments.size
    for name in (
        *("steps", "quality", "tolerance", "temporal_model", "seed", "binding", "format"),
        *("specular", "grain", "relief"),
    ):
        if (value := getattr(arguments, name)) is not None:
            setattr(settings, name, value)


def _apply_onset(arguments: argparse.Namespace, settings: properties.TVBRDF_PG_material) -> None:
    onset = arguments.onset
    if onset in (AUTO, EVERYWHERE):
        settings.onset = onset
    elif onset is not None and onset.startswith(ATTRIBUTE):
        settings.onset, settings.onset_attribute = "attribute", onset.removeprefix(ATTRIBUTE)
    elif onset is not None:
        settings.onset, settings.onset_image = "image", _image(onset)
    if arguments.onset_invert is None:
        return
    if settings.onset not in ("image", "attribute"):
        raise SettingsError(
            "There is no start image to invert, and no color attribute.", "Name one with --onset."
        )
    settings.onset_invert = arguments.onset_invert


def _image(name: str) -> bpy.types.Image:
    """The image in the file `name`, or else that of the .blend that is called so.

    Raises:
        SettingsError: there is neither, or it is no image.
    """
    path = Path(bpy.path.abspath(file_path(name)))
    if not path.is_file():
        if name in bpy.data.images:
            return bpy.data.images[name]
        raise SettingsError(
            f"There is no file {path} for --onset, and no image called {name} in the .blend.",
            f"Give auto, none, an image, or {ATTRIBUTE}NAME of a color attribute.",
        )
    image = bpy.data.images.load(str(path), check_existing=True)
    if min(image.size) == 0:  # only asking for the size reads it
        if not image.users:
            bpy.data.images.remove(image)
        raise SettingsError(f"{path} cannot be read as an image.", "Save it again as PNG.")
    return image


def _output(path: str) -> str:
    """The folder that `--output` names, as a setting; nothing where it names none."""
    return path if not path or path.startswith("//") else str(folder_meant(path, ""))
