"""Frames as maps: made band by band, the same as the whole image at once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model_runtime.brdf import principled
from model_runtime.images import read_image
from model_runtime.maps import PrincipledMaps, TorranceSparrowMaps
from model_runtime.modelling.compose import AgedTexels
from model_runtime.modelling.palette import Palette
from model_runtime.modelling.rollout import Histories
from model_runtime.output.frames import (
    FrameMaps,
    Frames,
    maps_of,
    write_frames,
    write_stored_frames,
)
from model_runtime.output.stored import StagedResult

SIZE = (70, 1000)  # three bands, the last one shorter
TIMES = (0.0, 0.2, 0.7, 1.0)


def authored(size: tuple[int, int] = SIZE) -> PrincipledMaps:
    """Half metal, half plastic; level, IOR and tint are one value throughout."""
    rng = np.random.default_rng(0)
    base = rng.uniform(0.1, 0.9, (*size, 3)).astype(np.float32)
    metallic = (rng.random(size) > 0.5).astype(np.float32)
    roughness = rng.uniform(0.2, 0.9, size).astype(np.float32)

    def one(value: float, *channels: int) -> np.ndarray:
        return np.broadcast_to(np.float32(value), (*size, *channels))

    return PrincipledMaps(base, metallic, one(0.5), roughness, one(1.5), one(1, 3))


def aging(maps: PrincipledMaps, seed: int = 1) -> AgedTexels:
    """Four histories that wander, starting at random times; a tenth of the texels never start."""
    start = principled.forward(maps)
    flat = np.concatenate((start.kd, start.ks, start.alpha[..., None]), -1).reshape(-1, 7)
    g = torch.Generator().manual_seed(seed)
    states = 0.3 + 0.1 * torch.randn(4, 1, 7, generator=g)
    states = (states + 0.1 * torch.rand(4, 5, 7, generator=g).cumsum(1)).clamp(0.01, 0.7)
    index = torch.randint(4, (len(flat),), generator=g)
    onset = (1.1 * torch.rand(len(flat), generator=g)).clamp_max(1)
    gain = torch.linspace(1, 0, 5)[:, None].expand(5, 7)
    palette = Palette(states[:, 0], index)
    return AgedTexels(torch.from_numpy(flat), palette, Histories(states, 0.0), gain, onset)


def whole(texels: AgedTexels, time: float, size: tuple[int, int] = SIZE) -> TorranceSparrowMaps:
    states = texels.at(time).numpy().reshape(*size, 7)
    return TorranceSparrowMaps(states[..., :3], states[..., 3:6], states[..., 6])


@pytest.mark.parametrize("time", TIMES)
def test_torrance_sparrow_maps_are_the_states(time: float) -> None:
    texels = aging(authored())
    maps = FrameMaps(texels, SIZE, "torrance-sparrow", None).at(time)
    for name, expected in vars(whole(texels, time)).items():
        np.testing.assert_array_equal(maps[name], expected.astype(np.float16), err_msg=name)


@pytest.mark.parametrize("time", TIMES)
def test_principled_maps_are_the_read_back_of_the_whole(time: float) -> None:
    material = authored()
    texels = aging(material)
    maps = FrameMaps(texels, SIZE, "principled", material).at(time)
    expected = principled.read_back(whole(texels, time), material)
    for name, pixels in maps.items():
        np.testing.assert_array_equal(pixels, getattr(expected, name).astype(np.float16), name)


def test_frame_1_is_the_input_to_the_bit_and_stays_so_where_nothing_starts() -> None:
    material = authored()
    texels = aging(material)
    maps = FrameMaps(texels, SIZE, "principled", material)
    assert texels.onset is not None
    still = (texels.onset == 1).numpy().reshape(SIZE)
    for name, first in maps.at(0.0).items():
        given = getattr(material, name).astype(np.float16)
        np.testing.assert_array_equal(first, given, name)
        np.testing.assert_array_equal(maps.at(1.0)[name][still], given[still], name)


def test_frames_may_be_asked_for_in_any_order() -> None:
    maps = FrameMaps(aging(authored()), SIZE, "torrance-sparrow", None)
    before = maps.at(0.3)
    maps.at(1.0)
    for name, pixels in maps.at(0.3).items():
        np.testing.assert_array_equal(pixels, before[name], name)


def test_exact_maps_and_what_they_cannot_hold() -> None:
    texels = aging(authored())
    assert maps_of(texels, authored(), SIZE, "principled-exact", TIMES).format == "torrance-sparrow"
    small = texels.select(torch.arange(6))
    small.initial[:] = torch.tensor((0.1, 0.1, 0.1, 0.2, 0.2, 0.2, 0.3))
    small.histories.states[:] = small.initial[0]
    maps = maps_of(small, authored((2, 3)), (2, 3), "principled-exact", TIMES)
    assert maps.format == "principled-exact"
    for name, value in (("base_color", 0.125), ("specular_tint", 0.25), ("roughness", 0.3**0.5)):
        np.testing.assert_allclose(maps.at(1.0)[name], value, rtol=1e-3, err_msg=name)


def test_a_uniform_material_is_one_texel() -> None:
    material = authored((1, 1))
    maps = FrameMaps(aging(material), (1, 1), "principled", material)
    assert {name: pixels.shape for name, pixels in maps.at(1.0).items()} == {
        "base_color": (1, 1, 3), "metallic": (1, 1), "specular": (1, 1), "roughness": (1, 1)
    }  # fmt: skip


def test_sampled_texels_are_those_of_the_whole() -> None:
    material = authored((3, 5))
    maps = FrameMaps(aging(material), (3, 5), "principled", material)
    for name, pixels in maps.sampled(0).at(0.6).items():
        np.testing.assert_array_equal(
            pixels[:, 0], maps.at(0.6)[name].reshape(15, *pixels.shape[2:])
        )


def test_a_spot_that_no_sample_meets_is_stored_all_the_same(tmp_path: Path) -> None:
    texels = aging(authored((300, 300)))
    spot = 12_345
    assert texels.onset is not None
    texels.onset[:] = 1
    texels.onset[spot] = 0
    maps = FrameMaps(texels, (300, 300), "torrance-sparrow", None)
    for seed in range(3):
        with StagedResult(tmp_path / str(seed)) as staged:
            files = write_stored_frames(
                Frames(maps, (0.0, 0.5, 1.0)), staged, lambda _: None, tolerance=45, seed=seed
            )
            staged.commit({"files": files})
        first, last = (
            read_image(tmp_path / str(seed) / f"kd_000{k}.exr", color=True).reshape(-1, 3)[spot]
            for k in (1, 3)
        )
        assert (first != last).any()


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 8])
@pytest.mark.parametrize("at_once", [False, True])
def test_frames_between_the_aged_ones_go_straight(count: int, at_once: bool) -> None:
    material = authored((3, 5))
    texels = aging(material)
    assert texels.onset is not None
    onset = texels.onset.numpy().reshape(3, 5)
    onset[0, 0] = 1  # to the bit the time of an aged frame
    if at_once:
        texels, onset = replace(texels, onset=None), np.zeros((3, 5), np.float32)
    maps = FrameMaps(texels, (3, 5), "principled", material)
    times = np.linspace(0, 1, count).tolist()
    frames = Frames(maps, times, interval=3)
    for k in range(count):
        before, after = k - k % 3, min(k - k % 3 + 3, count - 1)
        expected = maps.at(times[k])
        if k not in (before, after):
            first, last = (maps.at(times[end]) for end in (before, after))
            start = np.maximum(onset, times[before])
            whole = np.maximum(times[after] - start, 1e-9)
            share = np.clip((times[k] - start) / whole, 0, 1)
            for name, pixels in last.items():
                part = share[..., None] if pixels.ndim == 3 else share
                expected[name] = (1 - part) * first[name] + part * pixels
        for name, pixels in frames.at(k).items():
            assert pixels.dtype == np.float16
            np.testing.assert_allclose(pixels, expected[name], rtol=2e-3, atol=1e-3, err_msg=name)


def test_starts_that_are_known_come_nearer_than_a_fade() -> None:
    material = authored((30, 50))
    texels = aging(material)
    times = np.linspace(0, 1, 10).tolist()
    maps = FrameMaps(texels, (30, 50), "torrance-sparrow", None)
    frames = Frames(maps, times, interval=3)
    for k in (1, 2, 4, 5, 7, 8):
        before = k - k % 3
        first, true, last = (
            {name: pixels.astype(np.float32) for name, pixels in maps.at(times[each]).items()}
            for each in (before, k, before + 3)
        )
        for name, pixels in frames.at(k).items():
            faded = first[name] + (k - before) / 3 * (last[name] - first[name])
            error, of_fade = (np.square(each - true[name]).mean() for each in (pixels, faded))
            assert error < of_fade, (k, name)


def test_each_aged_frame_is_aged_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    material = authored((3, 5))
    maps = FrameMaps(aging(material), (3, 5), "principled", material)
    aged: list[float] = []
    planes = FrameMaps.planes
    monkeypatch.setattr(
        FrameMaps, "planes", lambda self, time: (aged.append(time), planes(self, time))[1]
    )
    times = np.linspace(0, 1, 9).tolist()
    with StagedResult(tmp_path / "aged") as staged:
        files = write_frames(Frames(maps, times, interval=3), staged, lambda _: None)
        staged.commit({"files": files})
    assert aged == [times[k] for k in (0, 3, 6, 8)]
