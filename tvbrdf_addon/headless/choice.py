"""Which materials of the file are meant, and which of them cannot be aged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import islice

import bpy

from ...model_runtime.errors import TvbrdfError
from ..errors import SettingsError
from ..log import said_of
from ..material.reading.check import why_not
from ..material.reading.chosen import object_named, object_with
from ..operators import find_material
from .jobs import Job
from .results import why_no_result
from .settings import Wanted

__all__ = ("Choice", "Task", "choose")

_ALL = "--all"


@dataclass(frozen=True)
class Task:
    """A material that is to be aged as `wanted`; `by_name` where it was named itself, and not with
    others by a pattern.
    """

    material: bpy.types.Material
    wanted: Wanted
    by_name: bool


@dataclass
class Choice:
    """The `tasks`, a material each; what is `refused`, and why, by what it was called; and
    materials `left_out` of patterns because they cannot be aged.
    """

    tasks: list[Task] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)


def choose(jobs: Sequence[Job], scene: bpy.types.Scene, share: tuple[int, int] = (1, 1)) -> Choice:
    """The materials that jobs name, with what is wanted kept in their settings.

    One that several name is aged once, as the last of them says.  What is refused keeps nothing
    else from being done.  `share` is the number of a task, from 1, and how many share the
    materials; what is not there is the first task's.
    """
    part, parts = share
    choice = Choice()
    tasks: dict[bpy.types.Material, Task] = {}
    for job in jobs:
        names = [*dict.fromkeys(job.arguments.material or ()), *[_ALL] * job.arguments.all]
        try:
            wanted = Wanted.of(job.arguments)
        except TvbrdfError as error:
            choice.refused |= dict.fromkeys(names, f"{job.place}{said_of(error)}")
            continue
        for name in names:
            try:
                found, by_name = _named(name)
            except SettingsError as error:
                choice.refused[name] = f"{job.place}{error}"
            else:
                tasks |= {each: Task(each, wanted, by_name) for each in found}
    if part > 1:
        choice.refused.clear()
    for task in islice(tasks.values(), part - 1, None, parts):
        _settle(task, scene, choice)
    return choice


def _named(name: str) -> tuple[list[bpy.types.Material], bool]:
    """The materials that `name` means, and whether it is the name of one.

    Raises:
        SettingsError: there are none.
    """
    if name == _ALL:
        found = [*bpy.data.materials]
        if not found:
            raise SettingsError("The file has no materials.")
        return found, False
    if name in bpy.data.materials or not any(each in name for each in "*?["):
        return [find_material(name)], True
    found = [each for each in bpy.data.materials if fnmatchcase(each.name, name)]
    if not found:
        raise SettingsError(f"No material has a name like {name}.")
    return found, False


def _settle(task: Task, scene: bpy.types.Scene, choice: Choice) -> None:
    """Adds a task to what is to be done, or says why not."""
    name = task.material.name
    try:
        if task.by_name or task.material.library is None:
            task.wanted.keep_in(task.material)
    except SettingsError as error:
        choice.refused[name] = str(error)
        return
    results = task.wanted.results
    reason = why_no_result(task.material, results) if results is not None else None
    if not task.by_name:
        reason = _why_not(task, scene) or reason
    if reason:
        (choice.refused if task.by_name else choice.left_out)[name] = reason
        return
    choice.tasks.append(task)


def _why_not(task: Task, scene: bpy.types.Scene) -> str | None:
    try:
        named = task.wanted.object_name
        obj = object_named(named, task.material, scene) if named else None
    except SettingsError as error:
        return str(error)
    return why_not(task.material, obj or object_with(task.material, scene))
