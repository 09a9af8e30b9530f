"""Installs an extension zip into the private profile that BLENDER_USER_RESOURCES names.

BLENDER_USER_RESOURCES=PROFILE python install.py EXTENSION.zip
"""

from __future__ import annotations

import sys

import bpy

assert bpy.ops.extensions.package_install_files(
    filepath=sys.argv[1], repo="user_default", enable_on_install=True
) == {"FINISHED"}
