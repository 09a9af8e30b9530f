"""Stands in for Blender's program where there is only its module, with the working tree enabled.

python blender_program.py -b FILE --command NAME ...
python blender_program.py -b FILE --render-output PATH --render-frame N
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import bpy

import tests.conftest  # noqa: F401 - which finds the working tree as `tvbrdf`
import tvbrdf

_commands: dict[str, Callable[[Sequence[str]], int]] = {}


def remember(name: str, function: Callable[[Sequence[str]], int]) -> str:
    _commands[name] = function
    return name


def main() -> int:
    background, file, option, value, *rest = sys.argv[1:]
    assert background == "-b"
    bpy.utils.register_cli_command = remember
    bpy.utils.unregister_cli_command = _commands.pop
    tvbrdf.register()
    bpy.ops.wm.open_mainfile(filepath=file)
    if option == "--command":
        return _commands[value](rest)
    assert (option, rest[0]) == ("--render-output", "--render-frame")
    scene = bpy.context.scene
    frame = int(rest[1])
    scene.frame_set(frame)
    scene.render.filepath = value.replace("####", f"{frame:04d}")
    bpy.ops.render.render(write_still=True)
    return 0


code = main()
tvbrdf.unregister()
sys.exit(code)
