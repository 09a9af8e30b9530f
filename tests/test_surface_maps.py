"""Maps of a surface as other tools bake them, and as nobody should."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from model_runtime.errors import InputError
from model_runtime.images import write_exr
from model_runtime.surface.maps import read_surface, surface_files
from tests.meshes import atlas_of, box, write_vectors

BLOCK = atlas_of(box((3, 0, 0.5), (1, 1, 1)), 64)


def baked(folder: Path, position: str = "position", normal: str = "normal") -> Path:
    write_vectors(folder / f"{position}.exr", BLOCK.position, BLOCK.covered)
    write_vectors(folder / f"{normal}.exr", BLOCK.normal)
    return folder


def test_what_was_baked_is_read(tmp_path):
    atlas = read_surface(baked(tmp_path))
    np.testing.assert_array_equal(atlas.covered, BLOCK.covered)
    place = atlas.position + np.float32(atlas.origin)
    np.testing.assert_allclose(place[atlas.covered], BLOCK.position[BLOCK.covered], atol=1e-5)
    np.testing.assert_allclose(atlas.normal, BLOCK.normal, atol=1e-5)
    assert atlas.area.sum() == pytest.approx(6, rel=0.03)
    assert atlas.features == {}


@pytest.mark.parametrize(
    ("position", "normal"),
    [
        ("Can_Position", "Can_Normal_World"),
        ("can_position", "can_normal_world"),
        ("can-world-position", "can-world-normal"),
    ],
)
def test_names_of_other_tools_will_do(tmp_path, position, normal):
    baked(tmp_path, position, normal)
    Image.new("L", (16, 16), 51).save(tmp_path / "Can_Ambient_Occlusion.png")
    Image.new("L", (16, 16), 204).save(tmp_path / "Can_Curvature.png")
    features = read_surface(tmp_path).features
    assert features["crevices"] == pytest.approx(0.8, abs=0.01)
    assert features["edges"] == pytest.approx(0.6, abs=0.01)


def test_a_set_of_textures_has_no_surface(tmp_path):
    write_vectors(tmp_path / "wood_normal.exr", BLOCK.normal)
    write_exr(tmp_path / "wood_basecolor.exr", BLOCK.normal)
    assert surface_files(tmp_path) == {}
    with pytest.raises(InputError, match=r"holds no position\.exr and normal\.exr"):
        read_surface(tmp_path)


def test_texels_without_a_place_or_a_normal_are_not_covered(tmp_path):
    position, normal = BLOCK.position.copy(), BLOCK.normal.copy()
    row, column = np.argwhere(BLOCK.covered)[:4].T
    position[row[0], column[0]] = np.nan
    position[row[1], column[1], 2] = np.inf
    normal[row[2], column[2]] = np.nan
    position[row[3], column[3]] = 1e30
    write_vectors(tmp_path / "position.exr", position)
    write_vectors(tmp_path / "normal.exr", normal)
    atlas = read_surface(tmp_path)
    expected = BLOCK.covered.copy()
    expected[row, column] = False
    np.testing.assert_array_equal(atlas.covered, expected)
    assert np.isfinite(atlas.position).all()


def test_what_is_far_from_the_origin_is_as_exact_as_can_be(tmp_path):
    write_vectors(tmp_path / "position.exr", BLOCK.position + np.float32((4096, 0, -512)))
    write_vectors(tmp_path / "normal.exr", BLOCK.normal)
    atlas = read_surface(tmp_path)
    assert np.abs(atlas.position).max() < 32


def test_hostile_maps_are_refused_with_a_sentence(tmp_path):
    def refused(sentence: str) -> None:
        with pytest.raises(InputError, match=sentence) as caught:
            read_surface(tmp_path)
        assert caught.value.hint

    baked(tmp_path)
    write_vectors(tmp_path / "position.exr", np.full((64, 64, 3), np.nan))
    refused("show no face")
    write_vectors(tmp_path / "position.exr", BLOCK.position[:32])
    refused("another size")
    write_exr(tmp_path / "position.exr", BLOCK.position[..., 0])
    refused("one channel")
    (tmp_path / "position.exr").write_bytes(b"v/1\x01" + bytes(64))
    refused("damaged")
    (tmp_path / "position.exr").unlink()
    Image.new("RGB", (8, 8)).save(tmp_path / "position.png")
    refused("cannot hold places")
    (tmp_path / "position.png").unlink()
    (tmp_path / "position.exr").symlink_to(tmp_path.parent / "elsewhere.exr")
    refused("cannot be read")
    with pytest.raises(InputError, match="cannot be read"):
        read_surface(tmp_path / "missing")


def test_large_maps_are_thinned_out(tmp_path, monkeypatch):
    monkeypatch.setattr("model_runtime.surface.maps._MOST_SIDE", 32)
    atlas = read_surface(baked(tmp_path))
    assert atlas.size == (32, 32)
    assert atlas.area.sum() == pytest.approx(6, rel=0.1)


def test_a_surface_is_read_once_until_its_files_change(tmp_path):
    folder = baked(tmp_path)
    first = read_surface(folder)
    assert read_surface(folder) is first
    pixels = np.where(first.covered[..., None], first.position + 1, 0)
    write_vectors(folder / "position.exr", pixels, first.covered)
    again = read_surface(folder)
    assert again is not first
    there = again.position + np.array(again.origin)
    assert np.abs(there - first.position - 1)[first.covered].max() < 1e-5
