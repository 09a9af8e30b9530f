"""Blender's own program in a window, where `windowed-blender` and its Blender are.

The tool is found through `TVBRDF_WINDOWED_BLENDER`, by default in ../shared/tools.  It runs
`windowed_panel.py`, which looks at the panel, clicks in it and leaves screenshots, and
`windowed_worker.py`, which loses its worker in every way; both with `stub_worker.py` for a worker,
as that Blender's Python (3.13) has no torch.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
DEFAULT_TOOL = ROOT.parent / "shared" / "tools" / "windowed-blender"
TOOL = Path(os.environ.get("TVBRDF_WINDOWED_BLENDER", DEFAULT_TOOL))
STUB = ROOT / "tests" / "stub_worker.py"
NUMPY = "numpy==2.5.5"
BLENDER = Path(os.environ.get("BLENDER_ROOT", "/var/tmp/blender-trixie")) / "usr/bin/blender"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        "TVBRDF_WINDOWED_BLENDER" not in os.environ and not (TOOL.is_file() and BLENDER.is_file()),
        reason="windowed-blender, or the Blender it runs, is not here",
    ),
]


def test_panel_is_drawn_and_clicked(tmp_path: Path) -> None:
    run_in_window("windowed_panel.py", tmp_path)
    starts = ("start_missing", "start_attribute", "start_new_image", "start_image")
    for shot in ("panel", "exact", "preview", "progress", "aged", *starts, "properties"):
        assert (tmp_path / f"{shot}.png").stat().st_size > 10_000


def test_the_program_survives_its_worker_and_its_extension(tmp_path: Path) -> None:
    run_in_window("windowed_worker.py", tmp_path)


def run_in_window(script: str, exchange: Path) -> None:
    build = [sys.executable, str(ROOT / ".ci" / "extension.py"), "build"]
    built = subprocess.run(
        [*build, "--wheels", "none", "--output", str(ROOT / "build")],
        check=True,
        capture_output=True,
        text=True,
    )
    for needed in (STUB, HERE / "windowed_steps.py"):
        shutil.copy(needed, exchange)
    unpack_numpy(exchange / "site-packages")
    run = subprocess.run(
        [str(TOOL), str(HERE / script), str(exchange), built.stdout.strip()],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stdout


def unpack_numpy(folder: Path) -> None:
    """numpy for Debian's Blender, the only one that comes without; fetched once."""
    kept = ROOT / "build" / "windowed"
    if not list(kept.glob("numpy-*.whl")):
        options = ["--no-deps", "--python-version", "3.13", "--only-binary=:all:", "--dest", kept]
        fetched = subprocess.run(
            [sys.executable, "-m", "pip", "download", "--quiet", *options, NUMPY],
            capture_output=True,
            text=True,
            check=False,
        )
        if fetched.returncode:
            pytest.skip(f"{NUMPY} for Python 3.13 is not to be had: {fetched.stderr}")
    (wheel,) = kept.glob("numpy-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
