"""The panel in a real window, where `windowed-blender` (../shared/tools) and its Blender are.

`windowed_panel.py` looks at the panel, clicks in it and leaves a screenshot; this runs it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
TOOL = ROOT.parent / "shared" / "tools" / "windowed-blender"
BLENDER = Path(os.environ.get("BLENDER_ROOT", "/var/tmp/blender-trixie")) / "usr/bin/blender"


@pytest.mark.slow
@pytest.mark.skipif(
    not (TOOL.is_file() and BLENDER.is_file()),
    reason="windowed-blender, or the Blender it runs, is not here",
)
def test_panel_is_drawn_and_clicked(tmp_path: Path) -> None:
    build = [sys.executable, str(ROOT / ".ci" / "extension.py"), "build"]
    built = subprocess.run(
        [*build, "--wheels", "none", "--output", str(ROOT / "build")],
        check=True,
        capture_output=True,
        text=True,
    )
    run = subprocess.run(
        [str(TOOL), str(HERE / "windowed_panel.py"), str(tmp_path), built.stdout.strip()],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stdout
    assert (tmp_path / "panel.png").stat().st_size > 10_000
