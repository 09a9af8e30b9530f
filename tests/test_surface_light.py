"""`age` by the light that falls on a surface: the dose is the age."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from model_runtime.cli import main
from model_runtime.images import read_vectors, write_exr
from model_runtime.surface.exposure import BLOCKED, SOUGHT
from model_runtime.surface.light import lit_timing
from tests.meshes import atlas_of, box, write_vectors

SIZE = 64
BLOCK = atlas_of(box((0, 0, 0.5), (1, 1, 1)), SIZE)
LIT = BLOCK.normal[..., 2] > 0.5  # from straight above

pytestmark = pytest.mark.usefixtures("signals_as_before")


def timing(light: np.ndarray, size=(SIZE, SIZE), **how):
    return lit_timing(BLOCK, light.astype(np.float32), size, **how)


def test_half_the_light_is_half_the_age_and_all_start_at_once():
    light = np.where(LIT, 1.0, np.where(BLOCK.normal[..., 0] > 0.5, 0.5, 0.0))
    found = timing(light)
    shown = BLOCK.covered
    assert not found.onset.any()
    np.testing.assert_allclose(found.rate[shown], light[shown].clip(1e-3), atol=1e-6)
    assert found.account["light"] == pytest.approx(1.5 / 6, abs=0.02)


def test_another_size_has_the_same_light():
    light = BLOCK.position[..., 2] - BLOCK.position[..., 2].min()
    found = timing(light, (2 * SIZE, 2 * SIZE)).rate
    means = found.reshape(SIZE, 2, SIZE, 2).mean((1, 3))[BLOCK.covered]
    differs = np.abs(means - light[BLOCK.covered].clip(1e-3))
    assert np.quantile(differs, 0.9) < 0.03, "but for the borders of islands, which touch here"


def test_an_amount_leaves_the_darkest_out_and_a_mask_has_the_last_word():
    light = np.where(LIT, 1.0, 0.2) * (1 + 0.1 * BLOCK.position[..., 0])
    some = timing(light, amount=0.5).onset[BLOCK.covered]
    assert some.mean() == pytest.approx(0.5, abs=0.05)
    blocked = (BLOCK.position[..., 1] > 0).astype(np.float32)
    never = timing(light, marks={BLOCKED: blocked}).onset
    np.testing.assert_array_equal(never[BLOCK.covered], blocked[BLOCK.covered])
    sought = timing(np.zeros_like(light), marks={SOUGHT: blocked}).rate
    assert set(np.unique(sought[BLOCK.covered])) == {np.float32(1e-3), np.float32(1)}


@pytest.fixture
def cloth(tmp_path: Path) -> Path:
    folder = tmp_path / "cloth"
    folder.mkdir()
    color = np.full((SIZE, SIZE, 3), (0.5, 0.05, 0.05), np.float32)
    write_exr(folder / "BaseColor.exr", color)
    write_exr(folder / "Roughness.exr", np.full((1, 1), 0.8, np.float32))
    return folder


def aged(source: Path, output: Path, *options: str) -> dict:
    usual = ["--ntm", "fading", "--binding", "live", "--frames", "2", "--output", str(output)]
    assert main(["age", "--input", str(source), *usual, *options]) == 0
    return json.loads((output / "aged.json").read_text())


def test_age_takes_an_image_of_the_light(cloth, tmp_path):
    surface, image = tmp_path / "surface", tmp_path / "light.png"
    surface.mkdir()
    write_vectors(surface / "position.exr", BLOCK.position, BLOCK.covered)
    write_vectors(surface / "normal.exr", BLOCK.normal)
    Image.fromarray((LIT * 255).astype(np.uint8)).save(image)
    told = aged(cloth, tmp_path / "out", "--surface", str(surface), "--light", str(image))
    assert told["surface"]["maps"] == ["light", "position", "normal"]
    assert len(told["hashes"]["light"]) == 64
    timing = read_vectors(tmp_path / "out" / "timing.exr", most=SIZE)
    assert not timing[..., 0].any()
    np.testing.assert_allclose(timing[..., 1][BLOCK.covered], LIT[BLOCK.covered], atol=2e-3)


def test_light_without_a_surface_counts_for_nothing_and_is_said(cloth, tmp_path):
    image = tmp_path / "light.png"
    Image.new("L", (SIZE, SIZE), 128).save(image)
    told = aged(cloth, tmp_path / "out", "--light", str(image))
    assert any("light" in warning and "surface" in warning for warning in told["warnings"])
