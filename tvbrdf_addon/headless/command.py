"""`blender -b scene.blend --command age_material --material NAME --ntm NAME --frames A-B ...`.

Exit codes: 0 everything asked for was written, 1 something was not (each with its reason), 2 wrong
usage, 130 interrupted by Ctrl-C, 143 by SIGTERM.  Where any material cannot be aged, the others
still are, and `--save-as` writes nothing; an interrupt leaves the material that is being aged as it
was and starts no other.  What a pattern means and cannot be aged is left out and said.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import bpy

from .. import session
from ..interrupt import Interrupts
from ..known import scene_of
from ..log import said_of, tell
from ..material.reading.passing import one_stage
from .choice import Task, choose
from .jobs import Job, jobs_of
from .parser import NAME, UsageError, parser
from .progress import Progress
from .results import bind_result, result_of
from .saving import require_file, require_place, save

__all__ = ("main", "register", "unregister")

_command: object | None = None


def main(argv: Sequence[str]) -> int:
    """Age the materials that `argv` names, in the file that is open; the exit code."""
    options = parser()
    with Interrupts() as interrupts:
        try:
            arguments = options.parse_args(argv)
            code = _run(arguments, jobs_of(arguments), interrupts)
        except UsageError as error:
            tell(f"{options.format_usage()}{NAME}: {error}", of_error=True)
            code = 2
        except SystemExit as end:  # of argparse
            code = int(end.code or 0)
        except Exception as error:
            code = _failed(said_of(error))
    return interrupts.exit_code or code


def _run(arguments: argparse.Namespace, jobs: Sequence[Job], interrupts: Interrupts) -> int:
    require_file()
    require_place(arguments.save_as)
    progress = Progress(arguments.progress, quiet=arguments.quiet)
    choice = choose(jobs, scene_of(bpy.context), arguments.share)
    for sentence in dict.fromkeys(choice.refused.values()):
        _failed(sentence)
    for name, reason in choice.left_out.items():
        tell(f"{name}: Left out: {reason}")
    failures = [*choice.refused]
    progress.materials = len(choice.tasks)
    with one_stage():
        for task in choice.tasks:
            if not _age(task, progress, interrupts):
                failures.append(task.material.name)
            progress.ended += 1
    if failures:
        unsaved = f" {arguments.save_as} was not written." if arguments.save_as else ""
        return _failed(f"Not aged: {', '.join(failures)}.{unsaved}")
    if interrupts.caught:
        return _failed("Interrupted when all was aged; nothing was saved.")
    saved = save(arguments.save_as)
    tell(f"{NAME}: {_counted(len(choice.tasks))} done{saved and f', saved as {saved}'}.")
    return 0


def _age(task: Task, progress: Progress, interrupts: Interrupts) -> bool:
    """Whether a task was done; says how it ended."""
    if interrupts.caught:
        return False
    name, results = task.material.name, task.wanted.results
    try:
        if results is not None:
            _bind(task, result_of(task.material, results), progress)
            return True
        run = session.age_and_wait(
            task.material,
            scene_of(bpy.context),
            task.wanted.object_name,
            cancelled=lambda: bool(interrupts.caught),
            told=progress.of,
        )
    except Exception as error:
        # One material's trouble must not keep the others from being aged.
        tell(f"{name}: {said_of(error)}", of_error=True)
        return False
    if run.size_reason:
        progress.note(f"{name}: {run.size_reason}")
    progress.note(f"{name}: {run.aged['frames']} frames in {run.plan.folder}")
    return True


def _bind(task: Task, folder: Path, progress: Progress) -> None:
    name, scene = task.material.name, scene_of(bpy.context)
    progress.say(name, 0.0, "Binding")
    for warning in bind_result(task.material, scene, task.wanted.object_name, folder):
        tell(f"{name}: Warning: {warning}")
    progress.note(f"{name}: shows {folder}")


def _counted(materials: int) -> str:
    return f"{materials} material{'s' * (materials != 1)}"


def _failed(sentence: str) -> int:
    tell(f"{NAME}: {sentence}", of_error=True)
    return 1


def register() -> None:
    global _command
    _command = bpy.utils.register_cli_command(NAME, main)


def unregister() -> None:
    global _command
    bpy.utils.unregister_cli_command(_command)
    _command = None
