"""The extension as an artist gets it: a zip, installed into a Blender that has nothing else."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from model_runtime.model_files import weights

if TYPE_CHECKING:
    from .conftest import RunBlender

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
OTHER_BLENDERS = os.environ.get("TVBRDF_BLENDERS", "").split()


def read_exr(file: Path) -> np.ndarray:
    import OpenEXR

    with OpenEXR.File(str(file), separate_channels=True) as picture:
        channels = picture.channels()
        return np.stack([channels[name].pixels for name in "RGB"], axis=-1)


def live_through(python: Path, zip_file: Path, folder: Path, run_blender: RunBlender) -> None:
    (folder / "profile").mkdir()
    run = run_blender(
        HERE / "lifecycle.py",
        zip_file,
        folder,
        python=python,
        env={"BLENDER_USER_RESOURCES": str(folder / "profile")},
    )
    assert "lifecycle complete" in run.stdout


@pytest.mark.slow
def test_installs_ages_renders_reverts_and_uninstalls(
    extension_zip: Path, run_blender: RunBlender, tmp_path: Path
) -> None:
    python = ROOT / ".venv-blender" / "bin" / "python"
    live_through(python, extension_zip, tmp_path, run_blender)


@pytest.mark.slow
def test_so_does_the_zip_without_torch(
    small_zip: Path, run_blender: RunBlender, tmp_path: Path
) -> None:
    python = ROOT / ".venv-blender" / "bin" / "python"
    live_through(python, small_zip, tmp_path, run_blender)


@pytest.mark.blenders
@pytest.mark.parametrize("zip_file", ["extension_zip", "small_zip"])
@pytest.mark.parametrize("version", OTHER_BLENDERS)
def test_does_the_same_in_other_blenders(
    version: str,
    zip_file: str,
    run_blender: RunBlender,
    tmp_path: Path,
    request: pytest.FixtureRequest,
) -> None:
    python = ROOT / f".venv-blender-{version}" / "bin" / "python"
    live_through(python, request.getfixturevalue(zip_file), tmp_path, run_blender)


def test_the_small_zip_brings_what_aging_needs_for_both_pythons(small_zip: Path) -> None:
    assert small_zip.stat().st_size <= 30e6
    with zipfile.ZipFile(small_zip) as archive:
        wheels = [Path(name).name for name in archive.namelist() if name.endswith(".whl")]
    assert {wheel.split("-")[0].lower() for wheel in wheels} == {"openexr", "safetensors", "pillow"}
    for library in ("openexr", "pillow"):
        tags = {wheel.split("-")[2] for wheel in wheels if wheel.startswith(library)}
        assert tags == {"cp311", "cp313"}


def test_no_wheel_lists_what_was_left_out_of_it(small_zip: Path) -> None:
    with zipfile.ZipFile(small_zip) as archive:
        pillow = next(name for name in archive.namelist() if "/pillow-" in name)
        with zipfile.ZipFile(io.BytesIO(archive.read(pillow))) as wheel:
            names = {name for name in wheel.namelist() if not name.endswith("/")}
            record = next(name for name in names if name.endswith("/RECORD"))
            listed = {line.split(",")[0] for line in wheel.read(record).decode().splitlines()}
    assert listed == names
    assert "PIL/AvifImagePlugin.py" in names
    assert not [name for name in names if "libavif" in name]


def test_zip_holds_what_belongs_and_nothing_else(extension_zip: Path) -> None:
    with zipfile.ZipFile(extension_zip) as archive:
        names = archive.namelist()
    rooms = {name.split("/")[0] for name in names}
    assert rooms == {
        *("__init__.py", "blender_manifest.toml", "LICENSE", "LICENSES"),
        *("manual", "model_runtime", "training", "tvbrdf_addon", "wheels"),
    }
    assert {"manual/manual.html", "manual/tutorial/aged.jpg"} <= set(names)
    learning = {name for name in names if name.startswith("training/")}
    assert {"training/learn.py", "training/learn_command.py", "training/ntm.py"} <= learning
    others = ("training/evaluation", "training/baselines", "training/encoder", "training/commands")
    assert not [name for name in learning if name.startswith(others)]
    wheels = {Path(name).name.split("-")[0].lower() for name in names if name.endswith(".whl")}
    assert {"torch", "openexr", "safetensors", "pillow"} <= wheels
    assert "numpy" not in wheels, "Blender brings its own numpy"
    models = {Path(name).name for name in names if name.startswith("model_runtime/models/")}
    assert {path.name for path in weights.MODELS.glob("*.safetensors")} <= models


def test_zip_is_built_once(extension_zip: Path) -> None:
    built = extension_zip.stat().st_mtime_ns
    make = [sys.executable, ROOT / ".ci" / "extension.py", "build"]
    folders = ["--wheels", ROOT / "build" / "wheels", "--output", ROOT / "build"]
    subprocess.run([*make, *folders], check=True, capture_output=True)
    assert extension_zip.stat().st_mtime_ns == built


@pytest.mark.slow
def test_saved_file_renders_the_same_without_the_extension(
    blender_script: RunBlender, run_blender: RunBlender, tmp_path: Path
) -> None:
    blender_script(HERE / "age_and_save.py", tmp_path)
    picture = tmp_path / "without_extension.exr"
    run_blender(HERE / "open_and_render.py", tmp_path / "small.blend", picture)
    np.testing.assert_array_equal(read_exr(picture), read_exr(tmp_path / "with_extension.exr"))


@pytest.mark.slow
def test_saved_file_opens_elsewhere_with_its_folder(
    blender_script: RunBlender, run_blender: RunBlender, tmp_path: Path
) -> None:
    here, elsewhere = tmp_path / "here", tmp_path / "else where é"
    here.mkdir()
    blender_script(HERE / "age_and_save.py", here)
    here.rename(elsewhere)
    picture = tmp_path / "elsewhere.exr"
    run_blender(HERE / "open_and_render.py", elsewhere / "small.blend", picture)
    np.testing.assert_array_equal(read_exr(picture), read_exr(elsewhere / "with_extension.exr"))


@pytest.mark.slow
def test_killed_worker_leaves_everything_as_it_was(
    blender_script: RunBlender, tmp_path: Path
) -> None:
    run = blender_script(HERE / "kill_worker.py", tmp_path)
    assert "REPORT:" in run.stdout


@pytest.mark.slow
def test_worker_ends_with_blender(blender_script: RunBlender, tmp_path: Path) -> None:
    blender_script(HERE / "age_and_save.py", tmp_path)
    deadline = time.monotonic() + 5
    while (left := _workers_in(tmp_path.parent)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not left


def _workers_in(folder: Path) -> list[str]:
    """Command lines of running workers whose code lies somewhere below `folder`."""
    commands = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            commands.append(file.read_bytes().decode(errors="replace"))
        except OSError:  # it ended meanwhile
            continue
    return [text for text in commands if "model_runtime" in text and str(folder) in text]
