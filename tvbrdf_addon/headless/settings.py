"""What was asked for on the command line, kept in a material's settings as the panel keeps it."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from ...model_runtime.contract import AUTO, EVERYWHERE
from ...model_runtime.model_files import weights
from .. import masks, preferences, properties
from ..errors import SettingsError
from ..output import folder_meant
from .parser import ATTRIBUTE
from .saving import file_path

__all__ = ("Wanted",)

# Options that are settings of the same name and values.
_AS_THEY_ARE = (
    *("steps", "quality", "tolerance", "temporal_model", "seed", "binding", "format"),
    *("specular", "grain", "relief", "pattern_size", "amount", "mask_means"),
    *("light", "latitude", "north"),
)


@dataclass(frozen=True)
class Wanted:
    """What a job says of its materials, looked up once for all of them.

    `values` are set one after the other, then `exposure` on top of what the model seeks; what is
    None or not among them stays as it is.  Materials are read from the object `object_name`, or
    one that shows them where that is empty.  With `results`, a folder of results, these are bound.
    """

    values: tuple[tuple[str, Any], ...]
    exposure: Mapping[str, float] | None
    onset_invert: bool | None
    object_name: str
    results: Path | None

    @classmethod
    def of(cls, arguments: argparse.Namespace) -> Wanted:
        """Raises `TvbrdfError` for a model, an image or a folder that is not there."""
        values: list[tuple[str, Any]] = [*_model(arguments.ntm)]
        values += zip(("frame_start", "frame_end"), arguments.frames, strict=True)
        values += _onset(arguments.onset)
        values += _mask(arguments.mask)
        if arguments.output is not None:
            values.append(("output", _output(arguments.output)))
        if arguments.size is not None:
            camera = arguments.size == AUTO
            values.append(("use_camera_size", True) if camera else ("size", arguments.size))
        values += [
            (name, value)
            for name in _AS_THEY_ARE
            if (value := getattr(arguments, name)) is not None
        ]
        return cls(
            values=tuple(values),
            exposure=arguments.exposure,
            onset_invert=arguments.onset_invert,
            object_name=arguments.object or "",
            results=_results(arguments.bind),
        )

    def keep_in(self, material: bpy.types.Material) -> None:
        """Keep it in the settings of `material`, as the panel does.

        Raises:
            SettingsError: it is linked, or has no start that could be inverted, or none by a mask.
        """
        settings = material.tvbrdf
        if material.library is not None:
            raise SettingsError(
                f"{material.name} is linked from another file.", "Make it local there first."
            )
        for name, value in self.values:
            setattr(settings, name, value)
        if self.exposure is not None:
            settings.use_own_exposure = True  # which takes over what the model seeks
            for name, weight in self.exposure.items():
                setattr(settings.exposure, name, weight)
        asked = dict(self.values)
        by_mask = asked.get("mask_source", masks.NO_MASK) != masks.NO_MASK or "mask_means" in asked
        if by_mask and masks.means(settings) is None:
            raise SettingsError(
                "Nothing grows by a mask where there is none, or where --onset is not auto.",
                "Name a mask with --mask, and leave --onset out.",
            )
        if self.onset_invert is None:
            return
        if settings.onset not in ("image", "attribute"):
            raise SettingsError(
                "There is no start image to invert, and no color attribute.",
                "Name one with --onset.",
            )
        settings.onset_invert = self.onset_invert


def _model(ntm: str | None) -> tuple[tuple[str, Any], ...]:
    if ntm is None:
        return ()
    if ntm.endswith(".safetensors"):
        return ("ntm", properties.OWN_FILE), ("ntm_file", str(Path(ntm).absolute()))
    weights.find_model(ntm, preferences.model_folders())
    return (("ntm", ntm),)


def _onset(onset: str | None) -> tuple[tuple[str, Any], ...]:
    if onset is None:
        return ()
    if onset in (AUTO, EVERYWHERE):
        return (("onset", onset),)
    if onset.startswith(ATTRIBUTE):
        return ("onset", "attribute"), ("onset_attribute", onset.removeprefix(ATTRIBUTE))
    return ("onset", "image"), ("onset_image", _image(onset, "--onset"))


def _mask(mask: str | None) -> tuple[tuple[str, Any], ...]:
    if mask is None:
        return ()
    if mask == masks.NO_MASK:
        return (("mask_source", mask),)
    if mask.startswith(ATTRIBUTE):  # named first: without a name that of the active one is taken
        return ("mask_attribute", mask.removeprefix(ATTRIBUTE)), ("mask_source", masks.ATTRIBUTE)
    return ("mask_source", masks.IMAGE), ("mask_image", _image(mask, "--mask"))


def _results(bind: str | None) -> Path | None:
    if bind is None:
        return None
    folder = Path(bpy.path.abspath(file_path(bind)))
    if not folder.is_dir():
        raise SettingsError(f"There is no folder {folder} for --bind.", "Age into it first.")
    return folder


def _image(name: str, where: str) -> bpy.types.Image:
    """The image in the file `name`, given for the option `where`, or else that of the .blend that
    is called so.

    Raises:
        SettingsError: there is neither, or it is no image.
    """
    path = Path(bpy.path.abspath(file_path(name)))
    if not path.is_file():
        if name in bpy.data.images:
            return bpy.data.images[name]
        raise SettingsError(
            f"There is no file {path} for {where}, and no image called {name} in the .blend.",
            f"Give none, an image, or {ATTRIBUTE}NAME of a color attribute.",
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
