"""`blender -b scene.blend --command age_material --material NAME --ntm NAME --frames A-B ...`.

Exit codes: 0 everything asked for was written, 1 something was not (each with its reason), 2 wrong
usage, 130 interrupted by Ctrl-C, 143 by SIGTERM.  Where any material cannot be aged, the others
still are, and `--save-as` writes nothing; an interrupt leaves the material that is being aged as it
was and starts no other.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Sequence
from pathlib import Path

import bpy

from ..model_runtime.console import Parser
from ..model_runtime.contract import (
    AUTO,
    BINDINGS,
    CHOICES,
    EVERYWHERE,
    QUALITIES,
    RANGES,
    SPECULARS,
    option,
)
from ..model_runtime.model_files import weights
from . import preferences, properties, session
from .errors import SettingsError
from .interrupt import Interrupts
from .known import scene_of
from .log import said_of, tell
from .operators import find_material
from .output import folder_meant

__all__ = ("main", "register", "unregister")

NAME = "age_material"
# Before the name of a color attribute, where an image could stand.
ATTRIBUTE = "attribute:"
# What a whole number in Blender can hold.
LARGEST = 2**31 - 1

_command: object | None = None


def main(argv: Sequence[str]) -> int:
    """Age the materials that `argv` names, in the file that is open; the exit code."""
    try:
        arguments = _parser().parse_args(argv)
    except SystemExit as end:
        return int(end.code or 0)
    with Interrupts() as interrupts:
        try:
            code = _run(arguments, interrupts)
        except Exception as error:
            code = _failed(said_of(error))
    return interrupts.exit_code or code


def _run(arguments: argparse.Namespace, interrupts: Interrupts) -> int:
    _require_place(arguments.save_as)
    materials = [find_material(name) for name in dict.fromkeys(arguments.material)]
    for material in materials:
        _apply(arguments, material)
    failures = [
        material.name
        for material in materials
        if not _age(material, arguments.object or "", interrupts)
    ]
    if failures:
        unsaved = f" {arguments.save_as} was not written." if arguments.save_as else ""
        return _failed(f"Not aged: {', '.join(failures)}.{unsaved}")
    if interrupts.caught:
        return _failed("Interrupted when all was aged; nothing was saved.")
    return _save(arguments.save_as)


def _age(material: bpy.types.Material, object_name: str, interrupts: Interrupts) -> bool:
    if interrupts.caught:
        return False
    name = material.name
    try:
        run = session.age_and_wait(
            material,
            scene_of(bpy.context),
            object_name,
            cancelled=lambda: bool(interrupts.caught),
        )
    except Exception as error:
        # One material's trouble must not keep the others from being aged.
        tell(f"{name}: {said_of(error)}", of_error=True)
        return False
    if run.size_reason:
        tell(f"{name}: {run.size_reason}")
    tell(f"{name}: {run.aged['frames']} frames in {run.plan.folder}")
    return True


def _apply(arguments: argparse.Namespace, material: bpy.types.Material) -> None:
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
    path = Path(bpy.path.abspath(_file_path(name)))
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


def _file_path(path: str) -> str:
    # `//` means beside the .blend; anything else is the shell's.
    return path if path.startswith("//") else str(Path(path).absolute())


def _output(path: str) -> str:
    """The folder that `--output` names, as a setting; nothing where it names none."""
    return path if not path or path.startswith("//") else str(folder_meant(path, ""))


def _require_place(save_as: str | None) -> None:
    """Raise SettingsError where `--save-as` is bound to fail, before an hour is spent on it."""
    if save_as is None:
        return
    path = Path(bpy.path.abspath(_file_path(save_as)))
    if save_as.startswith("//") and not bpy.data.filepath:
        raise SettingsError("No file is open, so // leads nowhere.", "Give --save-as a whole path.")
    if not path.parent.is_dir():
        raise SettingsError(f"There is no folder {path.parent} to save in.", "Make it first.")
    if path.exists() and not path.is_file():  # Blender replaces even a device
        raise SettingsError(f"{path} is no file.", "Name the .blend to save.")


def _save(save_as: str | None) -> int:
    if save_as is None:
        return 0
    path = bpy.path.abspath(_file_path(save_as))
    try:
        # Remapped, so that the textures are found from wherever it is saved.
        bpy.ops.wm.save_as_mainfile(filepath=path, relative_remap=True, check_existing=False)
    except RuntimeError as error:
        return _failed(f"{path} cannot be written: {error}".strip())
    tell(f"Saved {path}")
    return 0


def _failed(sentence: str) -> int:
    tell(f"{NAME}: {sentence}", of_error=True)
    return 1


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog=f"blender -b FILE.blend --command {NAME}",
        description="Age materials of the open file over the timeline.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--material", action="append", required=True, metavar="NAME", help="can be repeated"
    )
    parser.add_argument(
        "--object", metavar="NAME", help="object to read them from (one whose faces show them)"
    )
    parser.add_argument("--ntm", required=True, metavar="NAME_OR_FILE", help="rust, patina, ...")
    parser.add_argument(
        "--frames", type=_frames, required=True, metavar="A-B", help="the scene's range to age over"
    )
    parser.add_argument(
        "--steps", type=_whole(2, RANGES["frames"][1]), metavar="N", help="stages to model (36)"
    )
    parser.add_argument("--output", metavar="DIR", help="folder for all results (//aged)")
    parser.add_argument("--save-as", metavar="FILE", help="write the aged scene to this .blend")
    parser.add_argument(
        "--size",
        type=_size,
        metavar="auto|PX",
        help="longer side, of each UDIM tile; auto: what the cameras see",
    )
    parser.add_argument(
        "--tolerance", type=_number(10, 100, " of dB"), metavar="DB", help="10 to 100 dB (45)"
    )
    parser.add_argument(
        "--grain", type=_number(0, 1), metavar="SHARE", help="how much places differ, 0 to 1 (1)"
    )
    parser.add_argument(
        "--relief", type=_number(0, 1), metavar="SHARE", help="how much it rises and sinks (1)"
    )
    parser.add_argument(
        "--onset",
        metavar=f"auto|none|IMAGE|{ATTRIBUTE}NAME",
        help="where aging starts (auto): black in an image or a color attribute, white last",
    )
    parser.add_argument(
        "--onset-invert",
        action=argparse.BooleanOptionalAction,
        help="white first, black last",
    )
    parser.add_argument("--seed", type=_whole(0, LARGEST), metavar="N", help="of the onset (0)")
    for name, choices in (
        ("quality", QUALITIES),
        ("temporal_model", CHOICES["temporal_model"]),
        ("binding", BINDINGS),
        ("format", properties.SHOWN),
        ("specular", SPECULARS),
    ):
        parser.add_argument(option(name), choices=[*choices])
    return parser


def _frames(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(-?\d{1,18})-(-?\d{1,18})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text} is not a range such as 1-250")
    start, end = int(match[1]), int(match[2])
    if max(-start, end) > properties.LAST_FRAME:
        raise argparse.ArgumentTypeError(f"Blender knows no frame after {properties.LAST_FRAME}")
    if end <= start:
        raise argparse.ArgumentTypeError(f"{text} is empty: the last frame comes after the first")
    return start, end


def _whole(least: int, most: int):
    def whole(text: str) -> int:
        value = int(text) if re.fullmatch(r"-?\d{1,18}", text) else None
        if value is None or not least <= value <= most:
            raise argparse.ArgumentTypeError(
                f"{text} is not a whole number of at least {least} and at most {most}"
            )
        return value

    return whole


def _size(text: str) -> int | str:
    return text if text == AUTO else _whole(16, 8192)(text)


def _number(least: float, most: float, unit: str = ""):
    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(
                f"{text} is not a number{unit} from {least:g} to {most:g}"
            )
        return value

    return number


def register() -> None:
    global _command
    _command = bpy.utils.register_cli_command(NAME, main)


def unregister() -> None:
    global _command
    bpy.utils.unregister_cli_command(_command)
    _command = None
