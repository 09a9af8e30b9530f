"""Live results in EEVEE, which needs a window: every output of every case at every age.

Beside it are `live_shading.py`, `ages.json`, and `cases`, a folder of cases, which get their
pictures.
"""

from __future__ import annotations

import json

import bpy
from live_shading import build, render_ages
from windowed_steps import EXCHANGE, EXTENSION, Steps, away_with_the_splash_screen, go_through

ENGINE = "BLENDER_EEVEE_NEXT" if bpy.app.version < (5, 0) else "BLENDER_EEVEE"


def everything() -> Steps:
    yield from away_with_the_splash_screen()
    ages = json.loads((EXCHANGE / "ages.json").read_text(encoding="utf-8"))
    for case in sorted((EXCHANGE / "cases").iterdir()):
        material = build(EXTENSION, case)
        yield 0.1
        for _ in render_ages(material, ages[case.name], ENGINE, case):
            yield 0.01


go_through(everything(), "windowed live")
