"""Timing laid out as a surface is, where the maps of a material repeat on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from model_runtime.errors import InputError, UsageError
from model_runtime.images import read_image, write_exr
from model_runtime.request import request_from
from tests.aging import run, write_painted_steel
from tests.meshes import atlas_of, box
from tests.test_surface_maps import write_vectors

TILE, SURFACE = 32, 96


@pytest.fixture
def surface(tmp_path: Path) -> Path:
    block = atlas_of(box((0, 0, 0.5), (1, 1, 1)), SURFACE)
    folder = tmp_path / "surface"
    folder.mkdir()
    write_vectors(folder / "position.exr", block.position, block.covered)
    write_vectors(folder / "normal.exr", block.normal)
    return folder


@pytest.fixture
def tile(tmp_path: Path) -> Path:
    return write_painted_steel(tmp_path / "tile", TILE)


def timing_of(output: Path) -> np.ndarray:
    return read_image(output / "timing.exr", color=True)


def test_the_timing_is_the_surface_s_and_the_rest_the_material_s(tile, surface, tmp_path):
    asked = {"binding": "live", "surface": surface, "frames": 3}
    apart = run(tile, tmp_path / "apart", timing_apart=True, size=TILE, **asked)
    assert apart["size"] == [TILE, TILE] and "seam_ratio" in apart
    timing = timing_of(tmp_path / "apart")
    assert timing.shape[:2] == (TILE, TILE)
    larger = run(tile, tmp_path / "larger", timing_apart=True, **asked)
    assert larger["size"] == [TILE, TILE]
    assert timing_of(tmp_path / "larger").shape[:2] == (512, 512)
    uniform = tmp_path / "uniform"
    uniform.mkdir()
    write_exr(uniform / "BaseColor.exr", np.full((1, 1, 3), 0.5, np.float32))
    run(uniform, tmp_path / "alone", size=TILE, **asked)
    np.testing.assert_array_equal(timing, timing_of(tmp_path / "alone"))


def test_frames_cannot_stand_in_for_it(tile, surface, tmp_path, monkeypatch):
    monkeypatch.setattr("model_runtime.age.fit_live", lambda *_: None)
    with pytest.raises(InputError, match="shown in several places"):
        run(tile, tmp_path / "out", binding="live", surface=surface, timing_apart=True)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "fields", [{}, {"surface": "s", "binding": "frames"}, {"surface": "s", "onset": "none"}]
)
def test_it_needs_a_surface_and_a_live_material(fields):
    usual = {"input": "i", "ntm": "rust", "output": "o", "binding": "live", "timing_apart": True}
    with pytest.raises(UsageError, match="timing-apart needs a surface"):
        request_from({**usual, **fields})
