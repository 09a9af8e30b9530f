"""Grain and relief of aged materials: frames and live sums, in tiles and on surfaces."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from model_runtime.backend import torch
from model_runtime.contract import METERS, OF_TEXTURE
from model_runtime.images import read_image, write_exr
from model_runtime.live.files import read_live
from model_runtime.model_files.weights import load_model, save_model
from model_runtime.modelling.palette import appearance_psnr
from tests.aging import (
    TORRANCE_SPARROW,
    contents,
    frames_of,
    run,
    write_painted_steel,
    write_torrance_sparrow,
)
from tests.grained_model import write_grained_model
from tests.live_states import as_parameters, start_of
from tests.meshes import atlas_of, box, write_vectors

pytestmark = pytest.mark.usefixtures("one_thread")

FRAMES = 5
MAPS = {"format": "torrance-sparrow", "frames": FRAMES, "size": 64}


@pytest.fixture(scope="module")
def grained(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_grained_model(tmp_path_factory.mktemp("m") / "grained.safetensors", side=64))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory, grained: str) -> str:
    """The same model, and nothing but histories."""
    path = tmp_path_factory.mktemp("m") / "plain.safetensors"
    tensors, card = load_model(Path(grained), "ntm")
    kept = {k: v for k, v in tensors.items() if not k.startswith("grain.") and k != "height"}
    save_model(path, kept, card.details, kind="ntm")
    return str(path)


@pytest.fixture(scope="module")
def surface(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A box of one meter."""
    folder = tmp_path_factory.mktemp("surface")
    atlas = atlas_of(box((0, 0, 0.5), (1, 1, 1)), 96)
    for name in ("position", "normal"):
        write_vectors(folder / f"{name}.exr", getattr(atlas, name), atlas.covered)
    return folder


def states_of(folder: Path) -> NDArray[np.float32]:
    """[T, H, W, 7]"""
    kd, ks, alpha = (frames_of(folder, name, FRAMES) for name in TORRANCE_SPARROW)
    return np.concatenate((kd, ks, alpha[..., None]), -1)


def heights_of(folder: Path) -> NDArray[np.float32]:
    """[T, H, W]"""
    return frames_of(folder, "height", FRAMES)


class TestFrames:
    def test_without_grain_and_height_nothing_is_new(
        self, paint: Path, tmp_path: Path, grained: str, plain: str
    ):
        run(paint, tmp_path / "plain", ntm=plain, **MAPS)
        told = run(paint, tmp_path / "none", ntm=grained, grain=0.0, **MAPS)
        before, now = contents(tmp_path / "plain"), contents(tmp_path / "none")
        assert set(now) - set(before) == {f"height_{k:04d}.exr" for k in range(1, FRAMES + 1)}
        for name in before.keys() - {"aged.json"}:
            assert now[name] == before[name]
        assert told["height"] is True

    def test_a_plain_model_says_nothing_of_it(self, paint: Path, tmp_path: Path, plain: str):
        told = run(paint, tmp_path / "plain", ntm=plain, **MAPS)
        assert not {"height", "grain", "tile_side", "tile_unit"} & told.keys()
        assert "height" not in told["files"]

    def test_grain_grows_with_age_from_nothing(
        self, paint: Path, tmp_path: Path, grained: str, plain: str
    ):
        for name, ntm in (("grained", grained), ("plain", plain)):
            run(paint, tmp_path / name, ntm=ntm, **MAPS)
        away = states_of(tmp_path / "grained") - states_of(tmp_path / "plain")
        assert not away[0].any()
        spread = away[..., :3].std((1, 2, 3))
        assert (np.diff(spread) > 0).all()
        assert spread[-1] > 0.01
        assert np.abs(away[-1, ..., 1].mean()) < 0.25 * away[-1, ..., 1].std()
        heights = heights_of(tmp_path / "grained")
        assert not heights[0].any()
        assert heights[-1].mean() < -0.001  # it is gone by then
        assert heights[-1].std() > 0.0005

    def test_less_grain_is_less(self, paint: Path, tmp_path: Path, grained: str, plain: str):
        run(paint, tmp_path / "plain", ntm=plain, **MAPS)
        spread = []
        for share in (0.5, 1.0):
            run(paint, tmp_path / str(share), ntm=grained, grain=share, **MAPS)
            away = states_of(tmp_path / str(share)) - states_of(tmp_path / "plain")
            spread.append(away[-1, ..., 1].std())
        assert spread[0] == pytest.approx(spread[1] / 2, rel=0.15)

    @pytest.mark.parametrize("quality", ["draft", "balanced", "exact"])
    def test_every_quality_has_the_same(
        self, quality: str, paint: Path, tmp_path: Path, grained: str
    ):
        options: dict[str, Any] = {**MAPS, "frames": 31}
        run(paint, tmp_path / "out", ntm=grained, quality=quality, **options)
        run(paint, tmp_path / "exact", ntm=grained, quality="exact", **options)
        one, other = (frames_of(tmp_path / name, "height", 31) for name in ("out", "exact"))
        near = np.abs(one - other).mean() / np.abs(other).mean()
        assert near < (0.05 if quality == "draft" else 1e-4)  # whose frames are interpolated

    def test_sparse_heights_are_near_to_all(self, paint: Path, tmp_path: Path, grained: str):
        options: dict[str, Any] = {**MAPS, "frames": 17, "onset": "none"}
        run(paint, tmp_path / "all", ntm=grained, **options)
        told = run(paint, tmp_path / "few", ntm=grained, sparse=True, tolerance=40.0, **options)
        stored = {file for mix in told["files"]["height"] for file, _ in mix}
        assert 2 < len(stored) < 17
        truth = frames_of(tmp_path / "all", "height", 17)
        for k, mix in enumerate(told["files"]["height"]):
            shown = sum(
                weight * read_image(tmp_path / "few" / file, color=False) for file, weight in mix
            )
            assert np.abs(shown - truth[k]).mean() < 0.01 * np.ptp(truth)

    def test_where_nothing_changes_nothing_is_added(
        self, paint: Path, tmp_path: Path, grained: str
    ):
        told = run(paint, tmp_path / "out", ntm=grained, temporal_model="constant", **MAPS)
        assert "height" not in told["files"] and "height" not in told
        states = states_of(tmp_path / "out")
        assert (states == states[0]).all()

    def test_gray_highlights_stay_gray(self, tmp_path: Path, grained: str):
        source = write_torrance_sparrow(tmp_path / "in", size=16)
        run(source, tmp_path / "out", ntm=grained, specular="mono", **{**MAPS, "size": 16})
        ks = states_of(tmp_path / "out")[..., 3:6]
        assert np.abs(ks - ks[..., :1]).max() < 1e-3
        assert ks[-1].std() > 0

    def test_the_seed_draws_the_grain(self, paint: Path, tmp_path: Path, grained: str):
        for seed in (1, 2):
            run(paint, tmp_path / f"{seed}", ntm=grained, seed=seed, onset="none", **MAPS)
        one, other = (heights_of(tmp_path / f"{seed}")[-1].ravel() for seed in (1, 2))
        assert abs(np.corrcoef(one, other)[0, 1]) < 0.2

    def test_what_is_worn_has_its_own(self, tmp_path: Path, grained: str, plain: str):
        source = write_painted_steel(tmp_path / "paint", 64)
        run(source, tmp_path / "aged", ntm=plain, onset="none", **MAPS)
        half = write_torrance_sparrow(tmp_path / "half", size=64)
        for name in TORRANCE_SPARROW:
            first, last = (
                read_image(tmp_path / "aged" / f"{name}_000{k}.exr", color=name != "alpha")
                for k in (1, FRAMES)
            )
            first[:, 32:] = last[:, 32:]
            write_exr(half / f"{name}.exr", first)
        for name, ntm in (("grained", grained), ("plain", plain)):
            told = run(half, tmp_path / name, ntm=ntm, **MAPS)
            assert told["worn"] == pytest.approx(0.5, abs=0.1)
        away = np.abs(states_of(tmp_path / "grained") - states_of(tmp_path / "plain"))[-1, ..., 1]
        assert away[:, 36:].mean() < 0.1 * away[:, :28].mean()
        heights = np.abs(heights_of(tmp_path / "grained")[-1])
        assert heights[:, 36:].mean() < 0.1 * heights[:, :28].mean()


class TestLive:
    @pytest.mark.parametrize("onset", ["auto", "none"])
    def test_any_moment_is_that_of_the_frames(
        self, onset: str, paint: Path, tmp_path: Path, grained: str
    ):
        live = run(paint, tmp_path / "live", ntm=grained, binding="live", onset=onset)
        assert live["binding"] == "live" and live["grain"] == 3 and live["height"] is True
        assert 3 <= live["coefficients"] <= 12
        run(paint, tmp_path / "frames", ntm=grained, onset=onset, quality="exact", **MAPS)
        maps, start = read_live(tmp_path / "live"), start_of(paint)
        states, heights = states_of(tmp_path / "frames"), heights_of(tmp_path / "frames")
        np.testing.assert_array_equal(maps.at(start, 0.0), start)
        assert not maps.height(0.0).any()
        for k in range(1, FRAMES):
            time = k / (FRAMES - 1)
            shown = as_parameters(maps.at(start, time))
            assert appearance_psnr(torch.from_numpy(states[k].reshape(-1, 7)), shown) >= 45
            error = np.abs(maps.height(time) - heights[k])
            assert error.max() < 0.02 * np.abs(heights).max()

    def test_its_first_coefficients_are_those_without_grain(
        self, paint: Path, tmp_path: Path, grained: str, plain: str
    ):
        one = run(paint, tmp_path / "plain", ntm=plain, binding="live")
        two = run(paint, tmp_path / "grained", ntm=grained, binding="live")
        count = one["coefficients"]
        assert two["coefficients"] == count + 3
        assert two["error_db"] == one["error_db"]
        alone, grown = read_live(tmp_path / "plain"), read_live(tmp_path / "grained")
        np.testing.assert_array_equal(alone.coefficients, grown.coefficients[..., :count])
        np.testing.assert_array_equal(alone.curves.shapes, grown.curves.shapes[:count])
        assert np.abs(grown.coefficients[..., count:]).max() <= 1
        assert not grown.curves.shapes[:, 0].any() and not grown.curves.gain[:, 7].any()
        assert not alone.height(1.0).any()

    def test_a_uniform_material_has_grain_alone(self, tmp_path: Path, grained: str):
        source = write_torrance_sparrow(tmp_path / "steel")
        told = run(source, tmp_path / "out", ntm=grained, binding="live", size=32)
        assert (told["coefficients"], told["grain"]) == (3, 3)
        none = run(source, tmp_path / "none", ntm=grained, binding="live", size=32, grain=0.0)
        assert (none["coefficients"], none["grain"], none["height"]) == (0, 0, True)
        assert read_live(tmp_path / "none").height(1.0).any()

    def test_what_is_worn_has_its_own(self, tmp_path: Path, data_folder: Path, grained: str):
        source = data_folder / "scans" / "PaintedMetal007"
        told = run(source, tmp_path / "live", ntm=grained, binding="live", size=64)
        assert told["worn"] > 0.05
        assert told["grain"] == 3 and told["coefficients"] <= 12
        run(source, tmp_path / "frames", ntm=grained, quality="exact", **MAPS)
        shown = read_live(tmp_path / "live").height(1.0)
        truth = heights_of(tmp_path / "frames")[-1]
        assert np.abs(shown - truth).max() < 0.02 * np.abs(truth).max()

    def test_histories_that_need_many_leave_room_for_grain(
        self, tmp_path: Path, data_folder: Path, grained: str
    ):
        source = data_folder / "scans" / "Metal022"
        told = run(source, tmp_path / "live", ntm=grained, binding="live", size=256)
        assert told["binding"] == "live" and told["grain"] == 3
        assert told["coefficients"] <= 12
        curves = read_live(tmp_path / "live").curves
        assert curves.shapes.shape[0] == told["coefficients"]
        assert curves.shapes[-3:, -1].any((1,)).all()

    def test_what_the_exact_mapping_cannot_hold_with_its_grain_is_given_up(
        self, tmp_path: Path, grained: str
    ):
        source = write_torrance_sparrow(
            tmp_path / "in", kd=(0.9, 0.9, 0.9), ks=(0.02, 0.02, 0.02), size=16
        )
        options: dict[str, Any] = {"format": "principled-exact", "onset": "none", "size": 64}
        given = {}
        for grain in (0.0, 1.0):
            for binding in ("live", "frames"):
                told = run(
                    source, tmp_path / f"{binding}{grain}", ntm=grained, grain=grain,
                    binding=binding, frames=3, **options,
                )  # fmt: skip
                given[binding, grain] = told["format"]
        assert given["live", 1.0] == given["frames", 1.0]
        assert given["live", 0.0] == given["frames", 0.0]


class TestSurfaces:
    def test_grain_goes_on_across_seams_and_heights_are_meters(
        self, paint: Path, tmp_path: Path, grained: str, surface: Path
    ):
        told = run(paint, tmp_path / "out", ntm=grained, surface=surface, onset="none", **MAPS)
        assert told["tile_unit"] == METERS
        assert 0.2 < told["tile_side"] < 1.5
        tile = run(paint, tmp_path / "tile", ntm=grained, onset="none", **MAPS)
        assert (tile["tile_unit"], tile["tile_side"]) == (OF_TEXTURE, 0.5)
        flat, laid = heights_of(tmp_path / "tile"), heights_of(tmp_path / "out")
        assert laid[-1].mean() == pytest.approx(told["tile_side"] * flat[-1].mean(), rel=0.1)
        assert not laid[0].any()

    def test_a_smaller_copy_looks_the_same(
        self, paint: Path, tmp_path: Path, grained: str, surface: Path
    ):
        small = tmp_path / "small"
        small.mkdir()
        atlas = atlas_of(box((0, 0, 0.5 / 64), (1 / 64,) * 3), 96)
        for name in ("position", "normal"):
            write_vectors(small / f"{name}.exr", getattr(atlas, name), atlas.covered)
        told = {}
        for name, folder in (("large", surface), ("small", small)):
            told[name] = run(
                paint, tmp_path / name / "out", ntm=grained, surface=folder, onset="none", **MAPS
            )
        large, little = (heights_of(tmp_path / name / "out")[-1] for name in ("large", "small"))
        assert told["large"]["tile_side"] == pytest.approx(64 * told["small"]["tile_side"])
        assert np.corrcoef(large.ravel(), little.ravel())[0, 1] > 0.95
        assert large.std() == pytest.approx(64 * little.std(), rel=0.05)

    def test_finer_patterns_have_finer_grain_and_coarser_ones_the_usual(
        self, paint: Path, tmp_path: Path, grained: str, surface: Path
    ):
        side = {}
        for size in (None, 0.02, 10.0):
            told = run(
                paint, tmp_path / f"{size}", ntm=grained, surface=surface, pattern_size=size,
                **{**MAPS, "frames": 2},
            )  # fmt: skip
            side[size] = told["tile_side"]
        assert side[0.02] < side[None] == side[10.0]

    def test_live_on_a_surface_is_the_frames(
        self, paint: Path, tmp_path: Path, grained: str, surface: Path
    ):
        told = run(paint, tmp_path / "live", ntm=grained, surface=surface, binding="live")
        run(paint, tmp_path / "frames", ntm=grained, surface=surface, quality="exact", **MAPS)
        maps, heights = read_live(tmp_path / "live"), heights_of(tmp_path / "frames")
        for k in range(FRAMES):
            shown = maps.height(k / (FRAMES - 1)) * told["tile_side"]
            assert np.abs(shown - heights[k]).max() < 0.02 * np.abs(heights).max()

    def test_where_a_texture_repeats_its_grain_does(
        self, paint: Path, tmp_path: Path, grained: str, surface: Path
    ):
        told = run(
            paint, tmp_path / "out", ntm=grained, surface=surface, binding="live",
            timing_apart=True,
        )  # fmt: skip
        assert (told["tile_unit"], told["tile_side"]) == (OF_TEXTURE, 0.5)
        run(paint, tmp_path / "tile", ntm=grained, binding="live")
        apart, tile = (read_live(tmp_path / name).coefficients for name in ("out", "tile"))
        np.testing.assert_array_equal(apart[..., -3:], tile[..., -3:])

    def test_what_no_face_covers_has_what_is_near(
        self, paint: Path, tmp_path: Path, grained: str, surface: Path
    ):
        told = run(paint, tmp_path / "out", ntm=grained, surface=surface, binding="live")
        laid = read_live(tmp_path / "out").coefficients[..., -told["grain"] :]
        assert np.isfinite(laid).all()
        assert (np.abs(laid).max(-1) > 0).all()


def test_the_command_line_knows_how_much(paint: Path, tmp_path: Path, grained: str, capsys: Any):
    from model_runtime import cli

    command = ["age", "--input", str(paint), "--ntm", grained, "--output", str(tmp_path / "out")]
    assert cli.main([*command, "--frames", "2", "--size", "16", "--grain", "0.25"]) == 0
    told = json.loads((tmp_path / "out" / "aged.json").read_text())
    assert "--grain 0.25" in told["command"]
    for wrong in ("-0.1", "1.1", "nan"):
        assert cli.main([*command, "--grain", wrong]) == 2
        assert "--grain" in capsys.readouterr().err
