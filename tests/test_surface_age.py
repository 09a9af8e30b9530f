"""`age` grows over a surface that it is shown."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from model_runtime.cli import main
from model_runtime.images import read_vectors, write_exr
from tests.meshes import atlas_of, box, write_vectors

SIZE = 96
BLOCK = atlas_of(box((0, 0, 0.5), (1, 1, 1)), SIZE)


pytestmark = pytest.mark.usefixtures("signals_as_before")


@pytest.fixture
def steel(tmp_path: Path) -> Path:
    folder = tmp_path / "steel"
    folder.mkdir()
    write_exr(folder / "BaseColor.exr", np.full((SIZE, SIZE, 3), 0.5, np.float32))
    write_exr(folder / "Metallic.exr", np.ones((1, 1), np.float32))
    return folder


@pytest.fixture
def surface(tmp_path: Path) -> Path:
    folder = tmp_path / "surface"
    folder.mkdir()
    write_vectors(folder / "position.exr", BLOCK.position, BLOCK.covered)
    write_vectors(folder / "normal.exr", BLOCK.normal)
    return folder


def aged(source: Path, output: Path, *options: str, code: int = 0) -> dict:
    usual = ["--ntm", "rust", "--binding", "live", "--frames", "2", "--output", str(output)]
    assert main(["age", "--input", str(source), *usual, *options]) == code
    return json.loads((output / "aged.json").read_text()) if code == 0 else {}


def onset(output: Path) -> np.ndarray:
    return read_vectors(output / "timing.exr", most=SIZE)[..., 0]


def test_growth_follows_the_surface_and_says_so(steel, surface, tmp_path):
    told = aged(steel, tmp_path / "out", "--surface", str(surface))
    assert told["seam_ratio"] <= 1.3
    assert told["surface"]["maps"] == ["position", "normal"]
    assert told["surface"]["area"] == pytest.approx(6, rel=0.05)
    assert {"position.exr", "normal.exr"} == set(told["hashes"]["surface"])
    assert f"--surface {surface}" in told["command"]


def test_what_an_artist_asks_for_is_done(steel, surface, tmp_path):
    options = ["--exposure", "ground=1,edges=0,crevices=0,sky=0,runs=0,pattern=0.2"]
    options += ["--amount", "0.5", "--pattern-size", "0.1", "--starts", "0,0,0;0.5,0.2,0"]
    told = aged(steel, tmp_path / "out", "--surface", str(surface), *options)
    assert told["surface"]["exposure"]["ground"] == 1
    assert told["surface"]["pattern_size"] == 0.1
    assert told["surface"]["started"]["1.0"] == pytest.approx(0.5, abs=0.03)
    height, when = BLOCK.position[..., 2], onset(tmp_path / "out")
    assert when[BLOCK.covered & (height < 0.2)].mean() < 0.6
    assert when[BLOCK.covered & (height > 0.9)].mean() > 0.9


def test_a_texture_folder_that_holds_the_maps_has_a_surface(steel, surface, tmp_path):
    for file in surface.iterdir():
        file.rename(steel / f"steel_{file.stem.replace('normal', 'normal_world')}.exr")
    assert "surface" in aged(steel, tmp_path / "out")


def test_without_a_surface_all_is_as_it_was_and_what_counts_for_nothing_is_said(steel, tmp_path):
    told = aged(steel, tmp_path / "out", "--amount", "0.5")
    assert "surface" not in told and "seam_ratio" not in told
    assert any("count for nothing" in warning for warning in told["warnings"])
    assert aged(steel, tmp_path / "other")["warnings"] == []


@pytest.mark.parametrize(
    "options",
    [
        ("--exposure", "edges"),
        ("--exposure", "edges=2"),
        ("--exposure", "pattern=-0.5"),
        ("--exposure", "rain=1"),
        ("--exposure", "edges=nan"),
        ("--pattern-size", "0"),
        ("--pattern-size", "inf"),
        ("--starts", "1,2"),
        ("--starts", "1,2,nan"),
        ("--starts", "0,0,1e9;0,0,0"),
        ("--amount", "1.5"),
        ("--amount", "nan"),
    ],
)
def test_what_is_out_of_range_is_refused(steel, tmp_path, options, capsys):
    aged(steel, tmp_path / "out", *options, code=2)
    assert options[0] in capsys.readouterr().err


def test_a_surface_that_is_none_is_refused(steel, tmp_path, capsys):
    aged(steel, tmp_path / "out", "--surface", str(tmp_path / "nowhere"), code=1)
    assert "cannot be read" in capsys.readouterr().err
    aged(steel, tmp_path / "out", "--surface", str(tmp_path), code=1)
    assert "holds no position.exr" in capsys.readouterr().err


@pytest.fixture
def half(tmp_path: Path) -> Path:
    """White on what lies beyond x = 0, as a mask of another size."""
    file = tmp_path / "painted.png"
    white = (BLOCK.position[..., 0] > 0) & BLOCK.covered
    Image.fromarray(np.kron(white, np.ones((2, 2))).astype(np.uint8) * 255).save(file)
    return file


def started(output: Path) -> tuple[np.ndarray, np.ndarray]:
    """When it starts where the mask is white, and where it is black; a border's texel apart."""
    x, when = BLOCK.position[..., 0], onset(output)
    return when[BLOCK.covered & (x > 0.03)], when[BLOCK.covered & (x < -0.03)]


def test_what_is_painted_starts_first_or_alone_or_never(steel, surface, half, tmp_path):
    usual = ("--surface", str(surface), "--mask", str(half))
    told = aged(steel, tmp_path / "first", *usual)
    white, black = started(tmp_path / "first")
    assert np.quantile(white, 0.9) < np.quantile(black, 0.1)
    assert black.min() < 1, "it spreads from there"
    assert told["surface"]["mask"] == "first"
    assert set(told["hashes"]) >= {"mask", "surface"}
    assert f"--mask {half} --mask-means first" in told["command"]
    aged(steel, tmp_path / "only", *usual, "--mask-means", "only")
    white, black = started(tmp_path / "only")
    assert (black == 1).all() and white.mean() < 0.9
    aged(steel, tmp_path / "never", *usual, "--mask-means", "never")
    white, black = started(tmp_path / "never")
    assert (white == 1).all() and black.mean() < 0.9


def test_what_is_gray_starts_later(steel, surface, tmp_path):
    gray = tmp_path / "gray.png"
    Image.fromarray((BLOCK.position[..., 0] > 0).astype(np.uint8) * 128).save(gray)
    options = ("--surface", str(surface), "--mask", str(gray), "--mask-means", "never")
    aged(steel, tmp_path / "out", *options)
    white, black = started(tmp_path / "out")
    assert white.mean() > black.mean() + 0.2 and white.min() < 1


def test_a_mask_that_counts_for_nothing_is_said(steel, half, tmp_path):
    told = aged(steel, tmp_path / "out", "--mask", str(half))
    assert any("count for nothing" in warning for warning in told["warnings"])
    assert "mask" not in told["hashes"]


def test_a_mask_that_is_none_is_refused(steel, surface, tmp_path, capsys):
    options = ("--surface", str(surface), "--mask", str(tmp_path / "nothing.png"))
    aged(steel, tmp_path / "out", *options, code=1)
    assert "nothing.png" in capsys.readouterr().err
    aged(steel, tmp_path / "out", *options, "--mask-means", "maybe", code=2)
