"""Blender for tests, in two ways.

In this process (bpy from `.venv`; fast, shares one Blender between all tests):

- `empty_scene`: an empty factory file with the add-on registered from the working tree; yields
  the scene.  Ask for it in every test that touches bpy, because state leaks between tests.

In a process of its own (bpy from `.venv-blender`, which holds no torch, OpenEXR or safetensors):

- `extension_zip`: the zip an artist gets, wheels included, built at most once per content.
- `profile`: a private Blender profile with that zip installed, once per session.
- `blender_script(path, *arguments, check=True, timeout=300, env=None)`: runs a Python script in
  Blender with the profile's extension enabled and returns the `CompletedProcess` (stdout and
  stderr captured as text).  The script says `import bpy`; its arguments are in `sys.argv[1:]`.
  With `check`, a script that fails fails the test and shows what it printed.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import pytest

if TYPE_CHECKING:
    import bpy

ROOT = Path(__file__).resolve().parents[2]
CLI = ROOT / ".ci" / "extension.py"


class BlenderScript(Protocol):
    def __call__(
        self,
        script: Path,
        *arguments: str | Path,
        check: bool = True,
        timeout: float = 300,
        env: dict[str, str] | None = None,
    ) -> subprocess.CompletedProcess[str]: ...


@pytest.fixture
def empty_scene() -> Iterator[bpy.types.Scene]:
    import bpy
    import tvbrdf

    bpy.ops.wm.read_factory_settings(use_empty=True)
    tvbrdf.register()
    try:
        yield bpy.context.scene
    finally:
        tvbrdf.unregister()
        bpy.ops.wm.read_factory_settings(use_empty=True)
