"""Opens a saved file where the extension is absent and scripts are off; renders its last frame.

python open_and_render.py FILE.blend PICTURE.exr
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import small_scene

bpy.ops.wm.open_mainfile(filepath=sys.argv[1], use_scripts=False)
assert not hasattr(bpy.types.Material, "tvbrdf")
assert not bpy.context.preferences.filepaths.use_scripts_auto_execute
small_scene.picture(small_scene.STEPS, Path(sys.argv[2]))
