"""Ages the small scene, saves it, and leaves a picture of its last frame.

python run_with_extension.py age_and_save.py FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import small_scene

folder = Path(sys.argv[1])
small_scene.build(folder)
assert bpy.ops.tvbrdf.age_material() == {"FINISHED"}
bpy.ops.wm.save_mainfile()
small_scene.picture(small_scene.STEPS, folder / "with_extension.exr")
