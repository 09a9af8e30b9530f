"""What measures scrubbing measures it, for results that store all frames and for sparse ones."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.benchmarks import scrubbing
from tests.blender.windowed import needs_window

pytestmark = pytest.mark.slow
KINDS = ["every_frame_32", "live_0_32", "live_12_32", "live_4_32", "sparse_32"]
FILES = {"every_frame_32": 36, "live_0_32": 2, "live_12_32": 5, "live_4_32": 3, "sparse_32": 12}
IN_A_WINDOW = ["live_4_32", "sparse_32"]  # software draws it: each takes a minute
MAPS = 4  # of the material itself


@pytest.fixture
def results(tmp_path: Path) -> list[Path]:
    return scrubbing.gather([], tmp_path / "results", [32], 9)


def check(facts: dict, name: str) -> None:
    live = name.startswith("live")
    frames = 36 if live else 9
    assert (facts["result"], facts["size"], facts["frames"]) == (name, [32, 32], frames)
    assert facts["files"] == FILES[name]
    assert (facts["sequences"] == 0) == live
    # Of a live one all files are textures, but the curves.
    textures = FILES[name] - 1 if live else 3
    assert facts["sequences"] + facts["stills"] >= MAPS + textures
    assert all(each > 0 for each in (*facts["fps"].values(), *facts["core_ms"].values()))


def test_in_cycles_with_persistent_data_and_without(tmp_path: Path, results: list[Path]):
    for folder, name in zip(results, KINDS, strict=True):
        anew, persistent = scrubbing.in_cycles(folder, tmp_path)
        check(anew, name)
        check(persistent, name)
        assert (anew["viewer"], persistent["viewer"]) == (
            "Cycles, 64 px, 1 sample, anew",
            "Cycles, 64 px, 1 sample, persistent",
        )


@needs_window
def test_in_a_window(tmp_path: Path, results: list[Path]):
    for folder in results:
        if folder.name not in IN_A_WINDOW:
            shutil.rmtree(folder)
    report = scrubbing.in_window(tmp_path)
    assert report["renderer"]
    for facts, name in zip(report["measured"], IN_A_WINDOW, strict=True):
        check(facts, name)
        assert facts["viewer"].startswith("Material Preview")
