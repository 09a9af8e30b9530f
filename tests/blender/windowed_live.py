"""Live results in EEVEE, which needs a window: every output of every case at every age.

    windowed-blender windowed_live.py EXCHANGE_FOLDER EXTENSION.zip

The exchange folder must hold `live_shading.py`, `ages.json`, numpy for Python 3.13 in
`site-packages`, and `cases`, a folder of cases, which get their pictures.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path

import bpy

EXCHANGE = Path("/exchange")
sys.path[:0] = [str(EXCHANGE), str(EXCHANGE / "site-packages")]
from live_shading import build, render_ages  # noqa: E402

EXTENSION = "bl_ext.user_default.tvbrdf"
ENGINE = "BLENDER_EEVEE_NEXT" if bpy.app.version < (5, 0) else "BLENDER_EEVEE"


def everything() -> Iterator[float]:
    # Away with the splash screen.
    yield 1.0
    subprocess.run(["xdotool", "key", "Escape"], check=True)
    yield 1.0
    ages = json.loads((EXCHANGE / "ages.json").read_text(encoding="utf-8"))
    for case in sorted((EXCHANGE / "cases").iterdir()):
        material = build(EXTENSION, case)
        yield 0.1
        for _ in render_ages(material, ages[case.name], ENGINE, case):
            yield 0.01


steps = everything()


def advance() -> float:
    try:
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
            return next(steps)
    except StopIteration:
        os._exit(0)
    except BaseException:
        traceback.print_exc()
        os._exit(1)


bpy.app.timers.register(advance, first_interval=2, persistent=True)
