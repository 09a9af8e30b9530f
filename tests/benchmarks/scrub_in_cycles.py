"""Frame changes without a window: Cycles, 64 x 64 pixels, one sample.

python scrub_in_cycles.py RESULT_FOLDER OUTPUT.json persistent|anew
"""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType

import bpy
from scrub_scene import build, shading, show_result, size_of, summary, timed

ROOT = Path(__file__).resolve().parents[2]


def extension() -> ModuleType:
    """The working tree as an extension, registered."""
    spec = importlib.util.spec_from_file_location(
        "tvbrdf", ROOT / "__init__.py", submodule_search_locations=[str(ROOT)]
    )
    sys.modules["tvbrdf"] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.register()
    return module


def main() -> None:
    folder, output, data = sys.argv[1:]
    tvbrdf = extension()
    material = build(size_of(Path(folder)))
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.render.use_persistent_data = data == "persistent"
    still = timed(range(1, 8), bpy.ops.render.render)
    unaged = shading("CYCLES") if scene.render.use_persistent_data else 0.0
    facts = show_result(tvbrdf.__name__, material, Path(folder))
    frames = range(1, facts["frames"] + 1)
    first = timed(frames, bpy.ops.render.render)
    again = timed(frames, bpy.ops.render.render)
    facts |= {"viewer": f"Cycles, 64 px, 1 sample, {data}"} | summary(still, first, again)
    if scene.render.use_persistent_data:
        facts["shading_core_s"] = {"unaged": unaged, "aged": shading("CYCLES")}
    Path(output).write_text(json.dumps(facts), encoding="utf-8")
    tvbrdf.unregister()


main()
