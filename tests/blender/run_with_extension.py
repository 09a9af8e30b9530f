"""Runs a script in Blender as if it had been started with the profile's extension enabled.

    BLENDER_USER_RESOURCES=PROFILE python run_with_extension.py SCRIPT.py ARGUMENT...

Blender as a module always starts with factory settings, so what the profile has installed must be
enabled before SCRIPT.py runs.
"""

from __future__ import annotations

import runpy
import sys

import bpy  # noqa: F401 (before all else: it brings addon_utils)

MODULE = "bl_ext.user_default.tvbrdf"


def main() -> None:
    import addon_utils

    enabled = addon_utils.enable(MODULE, default_set=True)
    assert enabled is not None, f"{MODULE} could not be enabled"
    del sys.argv[0]
    runpy.run_path(sys.argv[0], run_name="__main__")


main()
