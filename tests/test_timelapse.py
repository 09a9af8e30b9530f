"""What a time-lapse tells, and what it says when it cannot be learned from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from model_runtime.errors import InputError
from tests.scans import save, srgb
from training.source import timelapse
from training.source.pictures import is_timelapse, read_pictures
from training.source.timelapse import change_of_timelapse, read_timelapse

Array = NDArray[np.float32]

FRAMES, SIDE = 24, 64
START, END = np.array((0.35, 0.2, 0.12)), np.array((0.1, 0.3, 0.22))


def pictures(*, glare: bool = False, seed: int = 0) -> Array:
    """Copper that turns green, the left half not all the way, fast at first: [T, H, W, 3]."""
    rng = np.random.default_rng(seed)
    grain = np.exp(0.15 * rng.standard_normal((SIDE, SIDE, 1)))
    far = np.where(np.arange(SIDE) < SIDE // 2, 0.5, 1.0)[None, :, None]
    time = 1 - np.exp(-5 * np.linspace(0, 1, FRAMES))
    stack = np.stack([grain * (START + t * far * (END - START)) for t in time])
    if glare:
        stack[:, :, 30:34] += 0.9 * (1 - 0.8 * time)[:, None, None, None]
    return stack.astype(np.float32)


def write_animation(path: Path, stack: Array) -> Path:
    codes = [Image.fromarray(np.rint(srgb(each) * 255).astype(np.uint8)) for each in stack]
    codes[0].save(path, save_all=True, append_images=codes[1:], lossless=True, duration=40)
    return path


@pytest.fixture(scope="module")
def copper(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_animation(tmp_path_factory.mktemp("lapse") / "copper.webp", pictures())


def test_numbered_pictures_are_those_of_the_animation(copper: Path, tmp_path: Path):
    stack = pictures()
    for k, each in enumerate(stack):
        save(tmp_path / f"copper_{k:03d}.png", srgb(each))
    assert is_timelapse(tmp_path)
    assert is_timelapse(copper)
    np.testing.assert_allclose(read_pictures(tmp_path), read_pictures(copper), atol=1e-6)
    assert np.abs(read_pictures(copper) - stack.clip(0, 1)).max() < 0.01


def test_a_folder_of_texture_maps_is_none(tmp_path: Path):
    for name in ("plate_Color", "plate_Roughness", "plate_Metalness"):
        save(tmp_path / f"{name}.png", np.zeros((8, 8), np.float32))
    assert not is_timelapse(tmp_path)


def test_what_changes_most_shows_what_becomes_of_all(copper: Path):
    change = change_of_timelapse(read_timelapse(copper), process="patina")
    assert np.allclose(change.mean[-1, :3], END, rtol=0.1)
    start = change.mean[0]
    assert np.allclose(start[:3], 0, atol=1e-3)  # taken for bare metal
    assert np.allclose(start[3:6], START, rtol=0.1)


def test_what_is_fast_at_first_is_given_room(copper: Path):
    gone = change_of_timelapse(read_timelapse(copper)).gone
    assert gone[0] == 0
    assert gone[-1] == 1
    assert (np.diff(gone) >= 0).all()
    half = np.argmax(gone > 0.5) / (len(gone) - 1)
    assert half > 1.5 * np.log(2) / 5  # when it was half way on the clock


class TestWhereNoOneHistoryDoes:
    """And no onsets can be told: what has changed by the same time."""

    @pytest.fixture(autouse=True)
    def without_onsets(self, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr(timelapse, "estimate_onset", lambda *_, **__: None)

    def test_the_pattern_is_that_of_hue_whatever_light_does(self, tmp_path: Path):
        ripple = 0.5 * np.sin(np.arange(SIDE) / 5)[:, None, None]
        light = 1 + ripple * np.linspace(0, 1, FRAMES)[:, None, None, None]
        film = write_animation(tmp_path / "a.webp", pictures() * light)
        weathered = change_of_timelapse(read_timelapse(film)).weathered
        assert weathered is not None
        assert weathered[:, SIDE // 2 + 2 :].mean() > 0.95
        assert weathered[:, : SIDE // 2 - 2].mean() < 0.05

    def test_noise_is_no_pattern(self, tmp_path: Path):
        rng = np.random.default_rng(0)
        detail = np.exp(0.3 * rng.standard_normal((SIDE, SIDE, 1)))  # that lies over itself
        fading = START + np.linspace(0, 1, FRAMES)[:, None, None, None] * (END - START)
        noise = np.exp(0.1 * rng.standard_normal((FRAMES, SIDE, SIDE, 3)))
        film = write_animation(tmp_path / "a.webp", fading * noise * detail)
        assert change_of_timelapse(read_timelapse(film)).weathered is None


def test_what_pictures_do_not_show_is_said(copper: Path):
    change = change_of_timelapse(read_timelapse(copper))
    assert not change.has_height
    assert any("no roughness" in told and "assumed" in told for told in change.told)


def test_a_highlight_is_left_out_and_its_fading_is_roughness(tmp_path: Path):
    lapse = read_timelapse(write_animation(tmp_path / "a.webp", pictures(glare=True)))
    assert lapse.glare is not None
    assert not lapse.usable[:, 30:34].any()
    assert lapse.usable.mean() > 0.75
    assert lapse.glare[0] == 1
    assert lapse.glare[-1] < 0.4
    change = change_of_timelapse(lapse)
    assert change.mean[-1, 6] > change.mean[0, 6] + 0.1
    assert any("highlight" in told for told in change.told)


def test_pictures_that_do_not_lie_over_each_other_are_refused(tmp_path: Path):
    stack = np.stack([np.roll(each, 5 * k, (0, 1)) for k, each in enumerate(pictures())])
    with pytest.raises(InputError, match="do not lie over each other"):
        read_timelapse(write_animation(tmp_path / "melon.webp", stack))


def test_so_is_the_melon(data_folder: Path):
    with pytest.raises(InputError, match="do not lie over each other"):
        read_timelapse(data_folder / "timelapse" / "decaying_melon.webp")


@pytest.mark.parametrize("name", ["copper_patinating", "clay_solidifying"])
def test_the_others_can_be_learned_from(data_folder: Path, name: str):
    lapse = read_timelapse(data_folder / "timelapse" / f"{name}.webp")
    assert lapse.usable.mean() > 0.8


def test_a_video_is_not_read_but_told_of(tmp_path: Path):
    (tmp_path / "rust.mp4").write_bytes(b"video")
    assert is_timelapse(tmp_path / "rust.mp4")
    with pytest.raises(InputError, match="Export its frames"):
        read_timelapse(tmp_path / "rust.mp4")


@pytest.mark.parametrize("content", [b"", b"RIFF0000WEBP"])
def test_a_damaged_animation_is_a_sentence(tmp_path: Path, content: bytes):
    (tmp_path / "a.webp").write_bytes(content)
    with pytest.raises(InputError, match="damaged or no animation"):
        read_pictures(tmp_path / "a.webp")


def test_a_still_is_no_time_lapse(tmp_path: Path):
    with pytest.raises(InputError, match="only 1 pictures"):
        read_pictures(write_animation(tmp_path / "a.webp", pictures()[:1]))
