"""The life of the extension in one Blender, of any version: each step leaves what it promises.

BLENDER_USER_RESOURCES=EMPTY_FOLDER python lifecycle.py EXTENSION.zip FOLDER
"""

from __future__ import annotations

import importlib.util
import os
import sys
import time
import zipfile
from pathlib import Path

import bpy
import numpy as np
import small_scene

MODULE = "bl_ext.user_default.tvbrdf"


def brings_torch(extension: Path) -> bool:
    with zipfile.ZipFile(extension) as archive:
        return any(name.startswith("wheels/torch-") for name in archive.namelist())


def installed(extension: Path, site_packages: Path) -> None:
    assert importlib.util.find_spec("torch") is None, "this environment has a torch of its own"
    bpy.ops.extensions.package_install_files(
        filepath=str(extension), repo="user_default", enable_on_install=True
    )
    assert MODULE in bpy.context.preferences.addons
    assert hasattr(bpy.types.Material, "tvbrdf")
    assert (site_packages / "PIL").is_dir()
    assert (site_packages / "torch").is_dir() == brings_torch(extension)


def learns_with_torch_alone(folder: Path, with_torch: bool) -> None:
    settings = bpy.context.window_manager.tvbrdf_lesson
    settings.source, settings.folder, settings.title = "folder", str(folder), "Lichen"
    assert bpy.ops.tvbrdf.learn.poll() == with_torch


def disabled_and_enabled() -> None:
    import addon_utils  # which importing bpy makes findable

    addon_utils.disable(MODULE, default_set=True)
    assert not hasattr(bpy.types.Material, "tvbrdf")
    assert not hasattr(bpy.types, "TVBRDF_OT_age_material")
    assert addon_utils.enable(MODULE, default_set=True) is not None
    assert hasattr(bpy.types.Material, "tvbrdf")


def aged_and_rendered(folder: Path) -> np.ndarray:
    """The picture of the first frame."""
    before = small_scene.picture(1, folder / "before.exr")
    assert bpy.ops.tvbrdf.age_material() == {"FINISHED"}
    first = small_scene.picture(1, folder / "first.exr")
    last = small_scene.picture(small_scene.STEPS, folder / "last.exr")
    # A procedural color baked into 64 x 64 texels and seen in 48 x 48 pixels is a little blurred.
    assert np.sqrt(np.mean((first - before) ** 2)) < 0.05 * np.sqrt(np.mean(before**2))
    assert np.sqrt(np.mean((last - before) ** 2)) > 0.05 * np.sqrt(np.mean(before**2))
    return before


def reopened(folder: Path) -> None:
    """The file looks the same after saving and opening it again."""
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    last = small_scene.picture(small_scene.STEPS, folder / "reopened.exr")
    np.testing.assert_array_equal(last, small_scene.pixels_of(folder / "last.exr"))


def reverted(folder: Path, before: np.ndarray) -> None:
    assert bpy.ops.tvbrdf.revert() == {"FINISHED"}
    again = small_scene.picture(small_scene.STEPS, folder / "reverted.exr")
    np.testing.assert_allclose(again, before, rtol=1e-5, atol=1e-6)


def uninstalled(site_packages: Path) -> None:
    (worker,) = small_scene.workers()
    repos = bpy.context.preferences.extensions.repos
    index = next(i for i, repo in enumerate(repos) if repo.module == "user_default")
    bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id="tvbrdf")
    assert MODULE not in bpy.context.preferences.addons
    assert not hasattr(bpy.types.Material, "tvbrdf")
    assert not (site_packages / "torch").exists()
    assert not (site_packages / "PIL").exists()
    assert not (Path(repos[index].directory) / "tvbrdf").exists()
    deadline = time.monotonic() + 5
    while worker in small_scene.workers() and time.monotonic() < deadline:
        time.sleep(0.1)
    assert worker not in small_scene.workers(), "the worker outlived the extension"


def main() -> None:
    extension, folder = (Path(argument) for argument in sys.argv[1:])
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    profile = Path(os.environ["BLENDER_USER_RESOURCES"])
    site_packages = profile / "extensions" / ".local" / "lib" / python / "site-packages"

    installed(extension, site_packages)
    disabled_and_enabled()
    learns_with_torch_alone(folder, brings_torch(extension))
    small_scene.build(folder)
    before = aged_and_rendered(folder)
    (worker,) = small_scene.workers()
    loaded = small_scene.mapped_torch(worker)
    assert bool(loaded) == brings_torch(extension), loaded
    assert all(file.is_relative_to(site_packages) for file in loaded), loaded
    reopened(folder)
    reverted(folder, before)
    uninstalled(site_packages)
    print(f"lifecycle complete in Blender {bpy.app.version_string}")


main()
