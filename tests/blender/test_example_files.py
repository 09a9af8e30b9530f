"""The example files: whoever drags a material out of them needs neither extension nor scripts."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from .conftest import RunBlender

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
SCRIPT = ROOT / "tests" / "demo" / "example_files.py"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def examples(
    run_blender: RunBlender,
    small_zip: Path,
    data_folder: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """The files as `make examples` leaves them, but for their size."""
    folder = tmp_path_factory.mktemp("examples")
    env = {
        "TVBRDF_DATA": str(data_folder),
        "TVBRDF_EXAMPLE_SIZE": "64",
        "BLENDER_USER_RESOURCES": str(folder / "profile"),
    }
    run_blender(SCRIPT, small_zip, sys.executable, folder, env=env, timeout=900)
    return folder


@pytest.mark.parametrize("how", ["append", "link"])
def test_materials_are_dragged_without_the_extension(
    how: str, examples: Path, run_blender: RunBlender
) -> None:
    run_blender(HERE / "drag_example.py", examples / "aged-materials.blend", how)


def test_scene_ages_without_the_extension(
    examples: Path, run_blender: RunBlender, tmp_path: Path
) -> None:
    said = run_blender(HERE / "open_example.py", examples / "example-scene.blend", tmp_path)
    assert "ages over its frames" in said.stdout


def test_says_nothing_of_the_machine(examples: Path, run_blender: RunBlender) -> None:
    for name in ("aged-materials.blend", "example-scene.blend"):
        run_blender(HERE / "list_paths.py", examples / name)
