"""What is told of a scan: which texels are weathered, how far in, and how they came to be so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from model_runtime.errors import InputError
from tests.scans import RUST, STEEL, MadeScan, save, write_plain, write_scan
from training.source.curves import Curves
from training.source.distance import signed_distance
from training.source.relief import _integrated, from_steps
from training.source.scan import Scan, change_of, read_states
from training.source.scan_maps import HEIGHT, ROUGHNESS, read_scan
from training.source.two_states import two_states


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> MadeScan:
    return write_scan(tmp_path_factory.mktemp("scan") / "plate")


@pytest.fixture(scope="module")
def scan(made: MadeScan) -> Scan:
    return read_states(made.folder)


@pytest.mark.parametrize("wraps", [(True, True), (False, True), (False, False)])
def test_distances_are_euclidean_and_go_around_the_edges(wraps: tuple[bool, bool]):
    inside = np.random.default_rng(3).random((40, 56)) > 0.97
    repeats = [3 if each else 1 for each in wraps]
    tiled = np.tile(inside, repeats)
    rows, columns = (
        slice(size, 2 * size) if each else slice(None)
        for size, each in zip(inside.shape, wraps, strict=True)
    )
    out, within = (
        np.asarray(distance_transform_edt(each))[rows, columns] for each in (~tiled, tiled)
    )
    expected = np.where(inside, within - 0.5, 0.5 - out)
    found = signed_distance(inside, wraps, most=60)
    assert np.abs(found - expected).max() < 1e-4


def test_no_distance_is_farther_than_asked():
    inside = np.zeros((64, 64), bool)
    inside[32, 32] = True
    found = signed_distance(inside, (False, False), most=10)
    assert found.min() == -10
    assert found.max() == 0.5


def test_what_is_weathered_is_found(made: MadeScan, scan: Scan):
    wrong = np.mean(scan.states.weathered != made.rusted)
    assert wrong < 0.01
    assert np.abs(scan.distance - made.distance)[np.abs(made.distance) < 20].max() < 2.5


def test_a_mask_says_it_instead(made: MadeScan, tmp_path: Path):
    half = np.zeros((50, 50), np.float32)
    half[:, 25:] = 1
    save(tmp_path / "mask.png", half)
    found = read_states(made.folder, mask=tmp_path / "mask.png").states.weathered
    assert not found[:, :90].any()
    assert found[:, 102:].all()


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_a_mask_of_one_kind_says_nothing(made: MadeScan, tmp_path: Path, level: float):
    save(tmp_path / "mask.png", np.full((9, 9), level))
    with pytest.raises(InputError, match="mask"):
        read_states(made.folder, mask=tmp_path / "mask.png")


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.3])
def test_a_plain_material_and_noise_show_no_two_states(tmp_path: Path, noise: float):
    with pytest.raises(InputError, match="no two states to learn from"):
        two_states(read_scan(write_plain(tmp_path / "plain", noise=noise)))


@pytest.mark.parametrize("name", ["Metal032", "Metal035", "Leather028", "Granite002A", "Fabric045"])
def test_nor_do_clean_materials(data_folder: Path, name: str):
    with pytest.raises(InputError, match="no two states to learn from"):
        two_states(read_scan(data_folder / "pbr" / name))


@pytest.mark.parametrize("name", ["Metal022", "CorrugatedSteel007B", "PaintedMetal007"])
def test_rust_is_what_is_weathered(data_folder: Path, name: str):
    found = read_states(data_folder / "scans" / name)
    clean, weathered = found.curves.clean, found.curves.weathered
    assert weathered[ROUGHNESS] > clean[ROUGHNESS] + 0.2
    assert weathered[0] > 2 * weathered[2]  # red over blue


class TestCurves:
    def test_both_ends_are_what_lies_far_from_the_border(self, scan: Scan):
        clean, weathered = scan.curves.clean, scan.curves.weathered
        assert np.allclose(clean[3:6], STEEL, atol=0.01)
        assert np.allclose(weathered[:3], RUST, rtol=0.06)
        assert abs(clean[ROUGHNESS] - 0.3) < 0.01
        assert abs(weathered[ROUGHNESS] - 0.85) < 0.01

    def test_age_begins_where_the_steel_lifts_and_rises_with_distance(self, scan: Scan):
        curves = scan.curves
        assert -16 < curves.first < -6  # the lip is at -4, and 2.5 wide
        assert 1 < curves.last < 12
        way = curves.distance_at(np.linspace(0, 1, 50, dtype=np.float32))
        assert (np.diff(way) >= 0).all()
        assert abs(way[0] - curves.first) < 1e-4
        assert abs(way[-1] - curves.last) < 1e-3

    def test_the_lip_comes_before_the_drop(self, scan: Scan):
        height = change_of(scan).mean[:, HEIGHT]
        top = height.argmax()
        assert height[0] == 0
        assert height[top] > 0.3 * np.ptp(height)
        assert height[-1] < 0
        assert top < np.argmax(height < 0)

    def test_share_gone_rises_from_nothing_to_all(self, scan: Scan):
        gone = change_of(scan).gone
        assert gone[0] == 0
        assert gone[-1] == 1
        assert (np.diff(gone) >= 0).all()


def test_the_residue_is_more_of_the_rust_and_wraps(scan: Scan):
    change = change_of(scan)
    tile = change.residue
    assert tile.shape == (192, 192, 8)
    deep = scan.distance > 8
    own = (scan.maps.values - scan.curves.mean_at(scan.distance))[deep]
    for channel in (0, 1, ROUGHNESS):
        assert tile[..., channel].std() == pytest.approx(own[:, channel].std(), rel=0.25)
    assert np.corrcoef(tile[..., 0].ravel(), tile[..., 1].ravel())[0, 1] > 0.8
    for axis in (0, 1):
        red = np.moveaxis(tile[..., 0], axis, 0)
        assert np.abs(red[0] - red[-1]).mean() < 1.5 * np.abs(np.diff(red, axis=0)).mean()


def test_grain_shows_as_what_was_there_goes(scan: Scan):
    change = change_of(scan)
    assert change.strength[0] == 0
    assert change.strength[-1] == 1
    assert (change.strength <= change.gone).all()  # no color that is neither's, nor between


def test_gaps_between_boards_are_no_grain(scan: Scan):
    grooved = replace(scan, maps=replace(scan.maps, values=scan.maps.values.copy()))
    grooved.maps.values[::48, :, HEIGHT] -= 3
    assert np.abs(change_of(grooved).residue[..., HEIGHT]).max() < 1 / 192  # of 3 texels


def test_a_photo_is_color_alone_and_that_is_said(made: MadeScan):
    found = read_states(made.folder / "plate_Color.png")
    assert np.mean(found.states.weathered != made.rusted) < 0.02
    assert not found.maps.has_height
    assert any("Only its color is known" in told for told in found.maps.told)


def test_a_crop_does_not_wrap_where_it_was_cut(scan: Scan):
    half = scan.maps.crop(slice(None), slice(0, 96))
    assert half.size == (192, 96)
    assert half.wraps == (True, False)
    assert isinstance(read_states(half).curves, Curves)


def test_normals_are_integrated_to_the_height_they_came_from():
    y, x = np.mgrid[:64, :96] / 96 * 2 * np.pi
    height = (np.sin(3 * x) + 0.5 * np.cos(1.5 * y * 2 + x)).astype(np.float32)
    down, across = ((np.roll(height, -1, axis) - np.roll(height, 1, axis)) / 2 for axis in (0, 1))
    found = _integrated(down, across, (True, True))
    assert np.corrcoef(found.ravel(), height.ravel())[0, 1] > 0.99
    assert found.std() == pytest.approx(height.std(), rel=0.1)


def test_steps_give_back_the_height_they_were_taken_of():
    height = np.random.default_rng(2).normal(0, 1, (32, 48)).astype(np.float32)
    steps = (np.roll(height, -1, axis) - height for axis in (0, 1))
    np.testing.assert_allclose(from_steps(*steps), height - height.mean(), atol=1e-4)
