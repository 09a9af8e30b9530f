"""What `age_material` may be told on the command line."""

from __future__ import annotations

import argparse
import math
import re

from ...model_runtime.console import Parser
from ...model_runtime.contract import (
    AUTO,
    BINDINGS,
    CHOICES,
    QUALITIES,
    RANGES,
    SPECULARS,
    option,
)
from .. import properties

__all__ = ("ATTRIBUTE", "NAME", "parser")

NAME = "age_material"
# Before the name of a color attribute, where an image could stand.
ATTRIBUTE = "attribute:"
# What a whole number in Blender can hold.
_LARGEST = 2**31 - 1


def parser() -> argparse.ArgumentParser:
    options = Parser(
        prog=f"blender -b FILE.blend --command {NAME}",
        description="Age materials of the open file over the timeline.",
        allow_abbrev=False,
    )
    options.add_argument(
        "--material", action="append", required=True, metavar="NAME", help="can be repeated"
    )
    options.add_argument(
        "--object", metavar="NAME", help="object to read them from (one whose faces show them)"
    )
    options.add_argument("--ntm", required=True, metavar="NAME_OR_FILE", help="rust, patina, ...")
    options.add_argument(
        "--frames", type=_frames, required=True, metavar="A-B", help="the scene's range to age over"
    )
    options.add_argument(
        "--steps", type=_whole(2, RANGES["frames"][1]), metavar="N", help="stages to model (36)"
    )
    options.add_argument("--output", metavar="DIR", help="folder for all results (//aged)")
    options.add_argument("--save-as", metavar="FILE", help="write the aged scene to this .blend")
    options.add_argument(
        "--size",
        type=_size,
        metavar="auto|PX",
        help="longer side, of each UDIM tile; auto: what the cameras see",
    )
    options.add_argument(
        "--tolerance", type=_number(10, 100, " of dB"), metavar="DB", help="10 to 100 dB (45)"
    )
    options.add_argument(
        "--grain", type=_number(0, 1), metavar="SHARE", help="how much places differ, 0 to 1 (1)"
    )
    options.add_argument(
        "--relief", type=_number(0, 1), metavar="SHARE", help="how much it rises and sinks (1)"
    )
    options.add_argument(
        "--onset",
        metavar=f"auto|none|IMAGE|{ATTRIBUTE}NAME",
        help="where aging starts (auto): black in an image or a color attribute, white last",
    )
    options.add_argument(
        "--onset-invert",
        action=argparse.BooleanOptionalAction,
        help="white first, black last",
    )
    options.add_argument("--seed", type=_whole(0, _LARGEST), metavar="N", help="of the onset (0)")
    for name, choices in (
        ("quality", QUALITIES),
        ("temporal_model", CHOICES["temporal_model"]),
        ("binding", BINDINGS),
        ("format", properties.SHOWN),
        ("specular", SPECULARS),
    ):
        options.add_argument(option(name), choices=[*choices])
    return options


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
