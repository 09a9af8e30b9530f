"""What `age_material` may be told: on the command line, and of some materials in a job file."""

from __future__ import annotations

import argparse
from typing import NoReturn

from ...model_runtime.console import Parser
from ...model_runtime.contract import (
    BINDINGS,
    CHOICES,
    MASK_MEANINGS,
    QUALITIES,
    RANGES,
    SPECULARS,
    option,
)
from .. import properties
from ..lights import LIGHTS
from . import values
from .progress import STYLES

__all__ = ("ATTRIBUTE", "NAME", "UsageError", "line_parser", "names_materials", "parser", "wanting")

NAME = "age_material"
# Before the name of a color attribute, where an image could stand.
ATTRIBUTE = "attribute:"
# What a whole number in Blender can hold.
_LARGEST = 2**31 - 1


class UsageError(ValueError):
    """Options that cannot be understood."""


class _LineParser(Parser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(message)


def parser() -> Parser:
    """Reads the command line."""
    options = Parser(
        prog=f"blender -b FILE.blend --command {NAME}",
        description="Age materials of the open file over the timeline.",
        allow_abbrev=False,
    )
    _add_materials(options)
    options.add_argument(
        "--jobs",
        metavar="FILE",
        help="more materials, one job a line in these options, which hold for it alone",
    )
    options.add_argument(
        "--share",
        type=values.share,
        default=(1, 1),
        metavar="K/N",
        help="of all these materials those of the K-th of N tasks, which have about as many each",
    )
    options.add_argument("--save-as", metavar="FILE", help="write the aged scene to this .blend")
    options.add_argument(
        "--progress",
        choices=STYLES,
        default=STYLES[0],
        help="how progress is printed: for people, or as Open Job Description has it",
    )
    options.add_argument(
        "--quiet", action="store_true", help="print warnings, errors and what came of it, no more"
    )
    _add_settings(options)
    _add_start(options)
    return options


def line_parser() -> Parser:
    """Reads a line of a job file; raises `UsageError`."""
    options = _LineParser(add_help=False, allow_abbrev=False)
    _add_materials(options)
    _add_settings(options)
    _add_start(options)
    return options


def names_materials(arguments: argparse.Namespace) -> bool:
    return bool(arguments.material or arguments.all)


def wanting(arguments: argparse.Namespace) -> str | None:
    """What a job that names materials still has to be told, or None."""
    needed = ("frames",) if arguments.bind is not None else ("ntm", "frames")
    missing = [option(name) for name in needed if getattr(arguments, name) is None]
    if not missing:
        return None
    return f"the following arguments are required: {', '.join(missing)}"


def _add_materials(options: Parser) -> None:
    options.add_argument(
        "--material",
        action="append",
        metavar="NAME",
        help="a name, or a pattern such as 'Paint*'; can be repeated",
    )
    options.add_argument(
        "--all", action="store_true", help="every material of the file that can be aged"
    )
    options.add_argument(
        "--object", metavar="NAME", help="object to read them from (one whose faces show them)"
    )
    options.add_argument(
        "--bind",
        metavar="DIR",
        help="age nothing, but show the results in DIR, as --output of another run left them",
    )


def _add_settings(options: Parser) -> None:
    options.add_argument("--ntm", metavar="NAME_OR_FILE", help="rust, patina, ...")
    options.add_argument(
        "--frames", type=values.frames, metavar="A-B", help="the scene's range to age over"
    )
    options.add_argument(
        "--steps",
        type=values.whole(2, RANGES["frames"][1]),
        metavar="N",
        help="stages to model (36)",
    )
    options.add_argument("--output", metavar="DIR", help="folder for all results (//aged)")
    options.add_argument(
        "--size",
        type=values.size,
        metavar="auto|PX",
        help="longer side, of each UDIM tile; auto: what the cameras see",
    )
    options.add_argument(
        "--tolerance", type=values.number(10, 100, " of dB"), metavar="DB", help="10 to 100 dB (45)"
    )
    options.add_argument(
        "--grain",
        type=values.number(0, 1),
        metavar="SHARE",
        help="how much places differ, 0 to 1 (1)",
    )
    options.add_argument(
        "--relief",
        type=values.number(0, 1),
        metavar="SHARE",
        help="how much it rises and sinks (1)",
    )
    for name, choices in (
        ("quality", QUALITIES),
        ("temporal_model", CHOICES["temporal_model"]),
        ("binding", BINDINGS),
        ("format", properties.SHOWN),
        ("specular", SPECULARS),
    ):
        options.add_argument(option(name), choices=[*choices])


def _add_start(options: Parser) -> None:
    """Where aging starts."""
    options.add_argument(
        "--onset",
        metavar=f"auto|none|IMAGE|{ATTRIBUTE}NAME",
        help="where aging starts (auto): black in an image or a color attribute, white last",
    )
    options.add_argument(
        "--exposure",
        type=values.exposure,
        metavar="edges=1,ground=-0.5",
        help="what it seeks, to 1, and avoids, to -1, where not as the model does",
    )
    options.add_argument(
        "--pattern-size",
        type=values.number(0, 1e6),
        metavar="UNITS",
        help="how large the spots are; 0 fits them to the object (0)",
    )
    options.add_argument(
        "--amount",
        type=values.number(0.01, 1),
        metavar="SHARE",
        help="how much of the surface has aged at the end (1)",
    )
    options.add_argument(
        "--onset-invert",
        action=argparse.BooleanOptionalAction,
        help="white first, black last",
    )
    options.add_argument(
        "--mask",
        metavar=f"none|IMAGE|{ATTRIBUTE}NAME",
        help="what is painted on the surface (none)",
    )
    options.add_argument(
        option("mask_means"), choices=[*MASK_MEANINGS], help="what happens where the mask is white"
    )
    options.add_argument(
        "--light", choices=[name for name, *_ in LIGHTS], help="what light it ages by (auto)"
    )
    options.add_argument(
        "--latitude",
        type=values.angle(90),
        metavar="DEGREES",
        help="where the sun of a year stands; negative in the south (45)",
    )
    options.add_argument(
        "--north",
        type=values.angle(360),
        metavar="DEGREES",
        help="where north lies, from Y counterclockwise (0)",
    )
    options.add_argument(
        "--seed", type=values.whole(0, _LARGEST), metavar="N", help="of the onset (0)"
    )
