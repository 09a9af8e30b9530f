"""Blender's own program in a window, for scripts that need one.

`windowed-blender` runs it on a screen of its own.  It is found through `TVBRDF_WINDOWED_BLENDER`,
by default in ../shared/tools; a test that is marked `needs_window` skips, by name, without it.
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
BLENDER = Path(os.environ.get("BLENDER_ROOT", "/var/tmp/blender-trixie")) / "usr/bin/blender"
NUMPY = "numpy==2.5.5"
START = """
import sys
sys.path[:0] = ["/exchange", "/exchange/site-packages"]
"""
AVAILABLE = "TVBRDF_WINDOWED_BLENDER" in os.environ or (TOOL.is_file() and BLENDER.is_file())

needs_window = pytest.mark.skipif(
    not AVAILABLE, reason="windowed-blender, or the Blender it runs, is not here"
)


def run_in_window(
    script: Path,
    exchange: Path,
    *beside: Path,
    seconds: int = 240,
    screen: str = "1600x1000",
    worker: bool = False,
) -> str:
    """Run a script in a window, where it can import `windowed_steps` and the files `beside` it.

    The working tree is installed there as the extension, with `worker` such that it ages without
    a stand-in.  `exchange` is /exchange to the script, which ends within `seconds`; one that fails
    raises an AssertionError with what it printed.  Returns what it printed.
    """
    wheels = ["--small", "--wheels", str(ROOT / "build" / "wheels")]
    build = [sys.executable, str(ROOT / ".ci" / "extension.py"), "build"]
    build += wheels if worker else ["--wheels", "none"]
    built = subprocess.run(
        [*build, "--output", str(ROOT / "build")], check=True, capture_output=True, text=True
    )
    for needed in (script, HERE / "windowed_steps.py", *beside):
        shutil.copy(needed, exchange)
    unpack_numpy(exchange / "site-packages")
    start = exchange / "start.py"
    start.write_text(START + f"import {script.stem}\n")
    run = subprocess.run(
        [str(TOOL), str(start), str(exchange), built.stdout.strip()],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"TIMEOUT": str(seconds), "SCREEN_SIZE": screen},
        check=False,
    )
    assert run.returncode == 0, run.stdout[-5000:]
    return run.stdout


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
