"""`age` by the light that falls on a surface: the dose is the age, seams do not show, edges do."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from model_runtime.cli import main
from model_runtime.errors import InputError
from model_runtime.images import read_vectors, write_exr
from model_runtime.surface.atlas import Atlas
from model_runtime.surface.exposure import BLOCKED, SOUGHT
from model_runtime.surface.light import lit_timing
from model_runtime.surface.maps import read_light
from tests.meshes import Patch, atlas_of, ball, box, quad, write_vectors

SIZE, FINE, COARSE = 64, 192, 72
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
    assert differs.max() < 0.03


def baked(atlas: Atlas, light: np.ndarray, size: int) -> np.ndarray:
    """What a coarse bake sees of light [H, W]: at the middles of texels, where a face is there."""
    middle = (np.arange(size) * 2 + 1) * len(light) // (2 * size)
    there = np.ix_(middle, middle)
    return np.where(atlas.covered[there], light[there], np.nan).astype(np.float32)


def by_the_sun(atlas: Atlas) -> np.ndarray:
    return (atlas.normal @ (np.array((0.3, -0.5, 1.0)) / np.sqrt(1.34))).clip(0).astype(np.float32)


def turned(patch: Patch, angle: float) -> Patch:
    """A patch that was turned about the vertical."""
    turn = np.eye(3)
    turn[:2, :2] = (np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle))
    return Patch(lambda v, u: patch.place(v, u) @ turn.T, patch.rim)


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_islands_side_by_side_take_nothing_of_each_other_s_light(angle: float):
    sides = [turned(each, angle) for each in box((0, 0, 0.5), (1, 1, 1))]
    block = atlas_of(sides, FINE, margin=0.004)  # a texel and a half apart
    light = by_the_sun(block)
    found = lit_timing(block, baked(block, light, COARSE), (FINE, FINE))
    differs = np.abs(found.rate - light.clip(1e-3))[block.covered]
    assert differs.max() < 0.01, "though a texel of the light shows three"
    assert found.seam_ratio is None, "it breaks at edges, as light does, and at no seam"


def test_it_goes_on_across_seams_as_inside_islands():
    globe = atlas_of(ball((0, 0, 0), 1.0), FINE, margin=0.004)
    light = by_the_sun(globe)
    noise = np.random.default_rng(0).normal(1, 0.02, (COARSE, COARSE)).astype(np.float32)
    found = lit_timing(globe, baked(globe, light, COARSE) * noise, (FINE, FINE))
    assert found.seam_ratio is not None and found.seam_ratio <= 1.3
    assert np.abs(found.rate - light.clip(1e-3))[globe.covered].max() < 0.06


def test_a_shadow_s_edge_stays_sharp():
    wall = atlas_of([quad((0, 0, 0), (1, 0, 0), (0, 1, 0))], FINE)
    across = (wall.position[..., 0] + 0.4 * wall.position[..., 1] - 0.7) / np.sqrt(1.16)
    light = (across > 0).astype(np.float32)
    found = lit_timing(wall, baked(wall, light, COARSE), (FINE, FINE)).rate
    soft = wall.covered & (found > 0.1) & (found < 0.9)
    assert np.ptp(across[soft]) * COARSE < 3, "texels of the light, whose own steps are 1.3"
    sharp = wall.covered & (np.abs(across) * COARSE > 3)
    np.testing.assert_allclose(found[sharp], light.clip(1e-3)[sharp], atol=0.05)


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


def test_an_image_that_knows_nothing_of_the_light_is_refused(tmp_path):
    write_vectors(tmp_path / "light.exr", np.full((4, 4, 3), np.nan))
    with pytest.raises(InputError, match=r"light\.exr shows no light.*[\s\S]*Bake it again"):
        read_light(tmp_path / "light.exr")
