"""Blender for tests, in two ways.

In this process (bpy from `.venv`; fast, one Blender for all tests):

- `empty_scene`: an empty factory file with the add-on registered from the working tree; yields
  the scene.  Ask for it in every test that touches bpy, because state leaks between tests.
- `stub_worker`: runs of the add-on are done by the stub, in a moment.

In a process of its own (bpy from `.venv-blender`, which holds no torch, OpenEXR or safetensors):

- `extension_zip`: the zip an artist gets, wheels included, built at most once per content;
  `small_zip`: the one without torch.
- `profile`: a private Blender profile with that zip installed, once per session.
- `blender_script(script, *arguments, check=True, timeout=300, env=None)`: runs a Python script in
  Blender with the profile's extension enabled and returns the `CompletedProcess` (stdout and
  stderr together, as text, in `stdout`).  The script says `import bpy`; its arguments are in
  `sys.argv[1:]`.  With `check`, a script that fails fails the test and shows what it printed.
  `run_blender` is the same without a profile: bare Blender, extension absent.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import pytest

if TYPE_CHECKING:
    import bpy

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
BLENDER_PYTHON = ROOT / ".venv-blender" / "bin" / "python"


class RunBlender(Protocol):
    def __call__(
        self,
        script: Path,
        *arguments: str | Path,
        python: Path = BLENDER_PYTHON,
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


@pytest.fixture
def stub_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TVBRDF_WORKER", str(HERE.parent / "stub_worker.py"))
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "0.05")


@pytest.fixture(scope="session")
def extension_zip() -> Path:
    return _built()


@pytest.fixture(scope="session")
def small_zip() -> Path:
    return _built("--small")


def _built(*options: str) -> Path:
    build = [sys.executable, str(ROOT / ".ci" / "extension.py"), "build", *options]
    folders = ["--wheels", str(ROOT / "build" / "wheels"), "--output", str(ROOT / "build")]
    run = subprocess.run([*build, *folders], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return Path(run.stdout.strip())


@pytest.fixture(scope="session")
def run_blender(tmp_path_factory: pytest.TempPathFactory) -> RunBlender:
    bare = tmp_path_factory.mktemp("bare-profile")

    def run(
        script: Path,
        *arguments: str | Path,
        python: Path = BLENDER_PYTHON,
        check: bool = True,
        timeout: float = 300,
        env: dict[str, str] | None = None,
    ) -> subprocess.CompletedProcess[str]:
        assert python.is_file(), f"{python} is missing: run the tests with make"
        surroundings = {
            name: value
            for name, value in os.environ.items()
            if name not in {"PYTHONPATH", "PYTHONHOME", "TVBRDF_WORKER"}
        }
        finished = subprocess.run(
            [str(python), str(script), *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=timeout,
            check=False,
            env={**surroundings, "BLENDER_USER_RESOURCES": str(bare), **(env or {})},
        )
        if check:
            assert finished.returncode == 0, f"{script.name} failed:\n{finished.stdout}"
        return finished

    return run


@pytest.fixture(scope="session")
def profile(
    extension_zip: Path, run_blender: RunBlender, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("profile")
    run_blender(HERE / "install.py", extension_zip, env={"BLENDER_USER_RESOURCES": str(folder)})
    yield folder
    shutil.rmtree(folder)  # a gigabyte


@pytest.fixture(scope="session")
def blender_script(profile: Path, run_blender: RunBlender) -> RunBlender:
    def run(
        script: Path,
        *arguments: str | Path,
        python: Path = BLENDER_PYTHON,
        check: bool = True,
        timeout: float = 300,
        env: dict[str, str] | None = None,
    ) -> subprocess.CompletedProcess[str]:
        return run_blender(
            HERE / "run_with_extension.py",
            script,
            *arguments,
            python=python,
            check=check,
            timeout=timeout,
            env={"BLENDER_USER_RESOURCES": str(profile), **(env or {})},
        )

    return run
