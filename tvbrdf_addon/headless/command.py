"""`blender -b scene.blend --command age_material --material NAME --ntm NAME --frames A-B ...`.

Exit codes: 0 everything asked for was written, 1 something was not (each with its reason), 2 wrong
usage, 130 interrupted by Ctrl-C, 143 by SIGTERM.  Where any material cannot be aged, the others
still are, and `--save-as` writes nothing; an interrupt leaves the material that is being aged as it
was and starts no other.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import bpy

from .. import session
from ..interrupt import Interrupts
from ..known import scene_of
from ..log import said_of, tell
from ..operators import find_material
from .parser import NAME, parser
from .saving import require_place, save
from .settings import apply

__all__ = ("main", "register", "unregister")

_command: object | None = None


def main(argv: Sequence[str]) -> int:
    """Age the materials that `argv` names, in the file that is open; the exit code."""
    try:
        arguments = parser().parse_args(argv)
    except SystemExit as end:
        return int(end.code or 0)
    with Interrupts() as interrupts:
        try:
            code = _run(arguments, interrupts)
        except Exception as error:
            code = _failed(said_of(error))
    return interrupts.exit_code or code


def _run(arguments: argparse.Namespace, interrupts: Interrupts) -> int:
    require_place(arguments.save_as)
    materials = [find_material(name) for name in dict.fromkeys(arguments.material)]
    for material in materials:
        apply(arguments, material)
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
    save(arguments.save_as)
    return 0


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
