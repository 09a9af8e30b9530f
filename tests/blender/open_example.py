"""Opens the example scene, without extension and scripts, and looks at its first and last frame.

python open_example.py SCENE.blend FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
from small_scene import pixels_of

bpy.ops.wm.open_mainfile(filepath=sys.argv[1], use_scripts=False)
assert not hasattr(bpy.types.Material, "tvbrdf")
scene = bpy.context.scene
assert (scene.frame_start, scene.frame_end) == (1, 120)
scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 24, 30, 2
scene.render.image_settings.file_format = "OPEN_EXR"
seen = []
for frame in (1, 120):
    scene.frame_set(frame)
    path = Path(sys.argv[2]) / f"{frame}.exr"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    seen.append(pixels_of(path))
assert np.abs(seen[0] - seen[1]).mean() > 0.02
print("ages over its frames")
