"""What is to be done, with which materials: the command line and the lines of a job file."""

from __future__ import annotations

import argparse
import shlex
from dataclasses import dataclass
from pathlib import Path

import bpy

from ...model_runtime.errors import reason, shown
from ..errors import SettingsError
from .parser import UsageError, line_parser, names_materials, wanting
from .saving import file_path

__all__ = ("Job", "jobs_of")

_MOST_BYTES = 1 << 20
_MOST_ERRORS = 20


@dataclass(frozen=True)
class Job:
    """What some materials are to become: the options that hold for them.

    `place` says where they were read, before a sentence: empty, or `FILE, line 3: `.
    """

    arguments: argparse.Namespace
    place: str = ""


def jobs_of(arguments: argparse.Namespace) -> list[Job]:
    """The job of the command line, where it names materials, and then those of its job file, which
    take from it what they do not say.

    Raises:
        UsageError: something is wanting, or lines cannot be understood: a text of some lines.
        SettingsError: the file cannot be read.
    """
    jobs = [Job(arguments)] if names_materials(arguments) else []
    if jobs and (missing := wanting(arguments)):
        raise UsageError(missing)
    if arguments.jobs is not None:
        jobs += _in_file(Path(bpy.path.abspath(file_path(arguments.jobs))), arguments)
    elif not jobs:
        raise UsageError("one of --material, --all and --jobs is required")
    return jobs


def _in_file(path: Path, usual: argparse.Namespace) -> list[Job]:
    jobs: list[Job] = []
    errors: list[str] = []
    options = line_parser()
    for number, line in enumerate(_text(path).splitlines(), 1):
        place = f"{shown(path.name)}, line {number}: "
        try:
            words = shlex.split(line, comments=True)
            if words:
                jobs.append(Job(_read(options, words, usual), place))
        except ValueError as error:
            errors.append(f"{place}{error}")
    if errors:
        more = len(errors) - _MOST_ERRORS
        rest = [f"{more} more lines are like that."] if more > 0 else []
        raise UsageError("\n".join([*errors[:_MOST_ERRORS], *rest]))
    return jobs


def _text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
        if len(content) > _MOST_BYTES:
            raise SettingsError(f"{path} is larger than 1 MB.", "Divide the jobs among files.")
        return content.decode("utf-8-sig")
    except OSError as error:
        raise SettingsError(f"{path} cannot be read ({reason(error)}).") from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"{path} is no text in UTF-8.", "Save it again as such.") from error


def _read(
    options: argparse.ArgumentParser, words: list[str], usual: argparse.Namespace
) -> argparse.Namespace:
    said = argparse.Namespace(**{**vars(usual), "material": None, "all": False})
    arguments = options.parse_args(words, said)
    if not names_materials(arguments):
        raise UsageError("one of --material and --all is required")
    if missing := wanting(arguments):
        raise UsageError(missing)
    return arguments
