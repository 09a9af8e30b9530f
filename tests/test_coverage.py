"""Texels that no face shows count nowhere, and look like the nearest that one does."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import distance_transform_cdt

from model_runtime.cli import main
from model_runtime.images import read_image, write_exr
from model_runtime.model_files.weights import find_model, read_card
from model_runtime.reading.coverage import Coverage, nearest_covered
from model_runtime.reading.inputs import read_covered, read_input

SIZE = 64
RNG = np.random.default_rng(5)


def island() -> np.ndarray:
    """Of a square: a quarter at its lower left corner, as an island of an unwrapped mesh."""
    covered = np.zeros((SIZE, SIZE), bool)
    covered[SIZE // 2 :, : SIZE // 2] = True
    return covered


def concrete(folder: Path, *, covered: np.ndarray | None, beside: float = 0.0) -> Path:
    """Maps of a gray concrete, on islands only; `beside` them is what a bake leaves."""
    folder.mkdir(parents=True)
    gray = 0.3 + 0.1 * RNG.random((SIZE // 2, SIZE // 2, 1))
    color = np.full((SIZE, SIZE, 3), beside)
    color[SIZE // 2 :, : SIZE // 2] = gray * (1, 0.97, 0.93)
    write_exr(folder / "BaseColor.exr", color.astype(np.float32))
    write_exr(folder / "Roughness.exr", np.full((1, 1), 0.85, np.float32))
    if covered is not None:
        write_exr(folder / "Coverage.exr", covered.astype(np.float32))
    return folder


def aged(source: Path, output: Path, *options: str) -> dict:
    usual = ["--ntm", "rust", "--frames", "4", "--output", str(output)]
    assert main(["age", "--input", str(source), *usual, *options]) == 0
    return json.loads((output / "aged.json").read_text())


@pytest.mark.parametrize("share", [0.001, 0.3, 0.999])
def test_the_nearest_is_the_nearest(share):
    covered = RNG.random((37, 53)) < share
    covered[20, 11] = True
    nearest = nearest_covered(covered)
    assert covered.reshape(-1)[nearest].all()
    rows, columns = np.divmod(nearest, 53)
    steps = np.abs(rows - np.indices(covered.shape)[0]) + np.abs(
        columns - np.indices(covered.shape)[1]
    )
    np.testing.assert_array_equal(steps, distance_transform_cdt(~covered, "taxicab"))


def test_the_nearest_within_reach():
    covered = np.zeros((9, 9), bool)
    covered[4, 2] = True
    nearest = nearest_covered(covered, reach=3)
    rows, columns = np.indices(covered.shape)
    expected = np.abs(rows - 4) + np.abs(columns - 2) <= 3
    np.testing.assert_array_equal(nearest, np.where(expected, 4 * 9 + 2, -1))
    assert (nearest_covered(np.zeros_like(covered), reach=3) == -1).all()


def test_maps_are_filled_before_they_shrink(tmp_path):
    """So that nothing black is mixed into the border of an island."""
    folder = concrete(tmp_path / "maps", covered=island())
    color = read_input(folder, size=SIZE // 3).base_color
    assert color.min() > 0.27
    covered = read_covered(folder, color.shape[:2])
    assert covered is not None
    assert covered.mean() == pytest.approx(0.25, abs=0.05)


def test_a_map_that_covers_all_or_nothing_says_nothing(tmp_path):
    for name, value in (("all", True), ("nothing", False)):
        folder = concrete(tmp_path / name, covered=np.full((4, 4), value))
        assert read_covered(folder, (SIZE, SIZE)) is None
    assert read_covered(concrete(tmp_path / "none", covered=None), (SIZE, SIZE)) is None


def test_numbers_that_no_face_shows_may_be_anything(tmp_path):
    folder = concrete(tmp_path / "maps", covered=island(), beside=-1.0)
    assert read_input(folder).base_color.min() > 0.27


def test_one_texel_stays_one():
    pixels = np.full((1, 1, 3), 0.5, np.float32)
    assert Coverage(island()).filled(pixels) is pixels


def test_an_island_is_judged_as_if_it_were_alone(tmp_path):
    """Domain, palette and plan: what is beside it, black or not, changes nothing of it."""
    whole = aged(concrete(tmp_path / "b", covered=island()), tmp_path / "bo")
    bare = aged(concrete(tmp_path / "c", covered=None), tmp_path / "co")
    light = aged(concrete(tmp_path / "w", covered=island(), beside=0.9), tmp_path / "wo")
    assert whole["warnings"] == []
    own = read_card(find_model("rust")).details["temporal_model"]
    assert whole["temporal_model"] == light["temporal_model"] == own
    assert whole["palette"] == pytest.approx(light["palette"], abs=3)
    assert "unlike anything" in " ".join(bare["warnings"])
    assert "for all 1,024" in " ".join(whole["plan"])
    assert "Coverage.exr" in whole["hashes"]["input"]


def test_what_lies_beside_ages_as_the_nearest_of_the_island(tmp_path):
    source = concrete(tmp_path / "maps", covered=island())
    aged(source, tmp_path / "out", "--onset", "none", "--grain", "0")
    for frame in (1, 2, 4):
        color = read_image(tmp_path / "out" / f"base_color_{frame:04d}.exr", color=True)
        nearest = nearest_covered(island())
        np.testing.assert_array_equal(color, color.reshape(-1, 3)[nearest])


def test_stored_frames_are_chosen_by_what_is_covered(tmp_path):
    source = concrete(tmp_path / "maps", covered=island())
    report = aged(source, tmp_path / "out", "--sparse")
    assert report["warnings"] == []
