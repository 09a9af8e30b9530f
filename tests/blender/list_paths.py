"""Looks for whole paths in a file that is to be handed out.

python list_paths.py FILE.blend
"""

from __future__ import annotations

import sys

import bpy

bpy.ops.wm.open_mainfile(filepath=sys.argv[1], use_scripts=False)
for image in bpy.data.images:
    if image.users and image.source == "FILE":
        assert image.packed_file, image.name
        assert image.filepath.startswith("//textures/"), image.filepath
for material in bpy.data.materials:
    settings = material.get("tvbrdf")
    folder = settings.get("folder", "") if settings is not None else ""
    assert not folder, folder
