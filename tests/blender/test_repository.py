"""A repository of our own: Blender installs from it, updates and goes back."""

from __future__ import annotations

import functools
import http.server
import shutil
import subprocess
import sys
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from .conftest import RunBlender

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
EXTENSION = [sys.executable, str(ROOT / ".ci" / "extension.py")]


def made(*command: str | Path) -> str:
    run = subprocess.run(
        [*EXTENSION, *map(str, command)], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    return run.stdout.strip()


def with_version(extension: Path, version: str, target: Path) -> Path:
    """A copy of a zip whose manifest has another version."""
    with zipfile.ZipFile(extension) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "blender_manifest.toml":
                content = content.replace(b'\nversion = "', f'\nversion = "{version}" # "'.encode())
            new.writestr(name, content)
    return target


@pytest.fixture
def shown(tmp_path: Path) -> Iterator[tuple[Path, str]]:
    """A folder, and the address under which this machine alone sees it."""
    folder = tmp_path / "shown"
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield folder, f"http://127.0.0.1:{server.server_port}/index.json"
        server.shutdown()


@pytest.mark.slow
def test_blender_installs_updates_and_goes_back(
    shown: tuple[Path, str], run_blender: RunBlender, tmp_path: Path
) -> None:
    extension = Path(made("build", "--wheels", "none", "--output", ROOT / "build"))
    for version in ("9.0.0", "9.0.1"):
        zip_file = with_version(extension, version, tmp_path / f"tvbrdf-{version}.zip")
        made("repository", "--output", tmp_path / version, zip_file)
    folder, url = shown
    shutil.copytree(tmp_path / "9.0.0", folder)
    (tmp_path / "profile").mkdir()
    run = run_blender(
        HERE / "use_repository.py",
        *(url, folder, tmp_path / "9.0.0", tmp_path / "9.0.1"),
        env={
            "BLENDER_USER_RESOURCES": str(tmp_path / "profile"),
            "TVBRDF_WORKER": str(HERE.parent / "stub_worker.py"),
            "TVBRDF_STUB_SECONDS": "0.05",
        },
    )
    steps = ("installed 9.0.0", "updated to 9.0.1", "back to 9.0.0")
    assert [line for line in run.stdout.splitlines() if line in steps] == list(steps)
