"""Adds a repository of extensions, installs the extension from it, updates it and goes back, while
the extension's worker is alive.

    BLENDER_USER_RESOURCES=PROFILE python use_repository.py URL FOLDER OLDER NEWER

FOLDER is what the web server at URL shows; OLDER and NEWER are repositories to put in its place.
"""

from __future__ import annotations

import shutil
import sys
import tomllib
from pathlib import Path

import bpy
import small_scene

URL, *FOLDERS = sys.argv[1:]
SHOWN, OLDER, NEWER = map(Path, FOLDERS)


def repository() -> tuple[int, bpy.types.UserExtensionRepo]:
    found = enumerate(bpy.context.preferences.extensions.repos)
    return next((index, each) for index, each in found if each.module == "ours")


def show(folder: Path) -> None:
    """Let the web server show what `folder` holds, and Blender see what has changed."""
    shutil.rmtree(SHOWN, ignore_errors=True)
    shutil.copytree(folder, SHOWN)
    assert bpy.ops.extensions.repo_sync(repo_index=repository()[0]) == {"FINISHED"}


def install() -> None:
    bpy.ops.extensions.package_install(
        repo_index=repository()[0], pkg_id="tvbrdf", enable_on_install=True
    )


def say(what: str) -> None:
    manifest = Path(repository()[1].directory) / "tvbrdf" / "blender_manifest.toml"
    version = tomllib.loads(manifest.read_text(encoding="utf-8"))["version"]
    assert bpy.ops.tvbrdf.age_material() == {"FINISHED"}  # its worker stays alive
    print(what, version, flush=True)


preferences = bpy.context.preferences
preferences.system.use_online_access = True
preferences.extensions.repos.new(name="Ours", module="ours", remote_url=URL)

show(OLDER)
install()
small_scene.build(SHOWN.parent)
say("installed")

show(NEWER)
assert bpy.ops.extensions.package_upgrade_all() == {"FINISHED"}
say("updated to")

show(OLDER)
install()
say("back to")
