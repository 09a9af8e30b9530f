"""The live binding: a sum of few coefficients that stands for all frames, and its files."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from model_runtime.images import read_bytes, read_image, write_exr
from model_runtime.live.evaluate import BYTES, HALVES, Curves, LiveMaps
from model_runtime.live.files import read_live
from model_runtime.live.fitting import fit_live
from model_runtime.live.low_rank import at_ages
from model_runtime.modelling.compose import AgedTexels
from model_runtime.modelling.palette import Palette, appearance_psnr, build_palette
from model_runtime.modelling.rollout import Histories
from tests.aging import (
    TORRANCE_SPARROW,
    Listener,
    contents,
    frames_of,
    run,
    write_painted_steel,
    write_torrance_sparrow,
)
from tests.live_states import as_parameters, start_of

pytestmark = pytest.mark.usefixtures("one_thread")

AGES = 5


def by_hand(start, coefficients, age, curves: Curves) -> np.ndarray:
    """One texel's state and height, one number after the other, in double precision."""
    if age == 0:
        return np.array((*start, 0))
    place = age * (len(curves.gain) - 1)
    k = min(int(place), len(curves.gain) - 2)
    state = []
    for channel in range(8):

        def at(curve, channel=channel) -> float:
            return curve[k][channel] + (place - k) * (curve[k + 1][channel] - curve[k][channel])

        value = at(curves.gain) * (*start, 0)[channel] + at(curves.offset)
        value += sum(c * at(v) for c, v in zip(coefficients, curves.shapes, strict=True))
        limits = (0, np.inf) if channel < 6 else (0.01, 1) if channel == 6 else (-np.inf, np.inf)
        state.append(np.clip(value, *limits))
    return np.array(state)


def some_curves(count: int = 2) -> Curves:
    rng = np.random.default_rng(0)
    gain, offset, *shapes = rng.normal(0, 0.5, (2 + count, AGES, 8)).astype(np.float32)
    gain[0], gain[:, 7], offset[0] = 1, 0, 0
    shapes = np.reshape(shapes, (count, AGES, 8)).astype(np.float32)
    shapes[:, 0] = 0
    return Curves(gain, offset, shapes)


class TestSum:
    @pytest.mark.parametrize("age", [0.0, 0.01, 0.25, 0.6, 1.0])
    def test_is_the_formula(self, age: float):
        curves, rng = some_curves(), np.random.default_rng(1)
        start = rng.random((40, 7)).astype(np.float32)
        coefficients = rng.normal(size=(40, 2)).astype(np.float32)
        ages = np.full(40, age, np.float32)
        expected = [by_hand(s, c, age, curves) for s, c in zip(start, coefficients, strict=True)]
        found = curves.at(start, coefficients, ages), curves.heights(coefficients, ages)[:, None]
        np.testing.assert_allclose(np.concatenate(found, 1), expected, atol=1e-5)

    def test_age_0_is_the_start_to_the_bit_even_where_the_sum_would_not_be(self):
        start = np.array([[2.0, 0, 0, 0, 0, 0, 0.001]], np.float32)
        states = some_curves().at(start, np.full((1, 2), 9, np.float32), np.zeros(1, np.float32))
        np.testing.assert_array_equal(states, start)

    def test_each_texel_has_the_age_that_its_timing_says(self):
        curves = some_curves(1)
        timing = np.array([[[0.5, 0.8, 0.0], [0.0, 1.0, 0.3], [0.2, 0.5, 0.9]]], np.float32)
        maps = LiveMaps(curves, timing, np.ones((1, 3, 1), np.float32))
        start = np.full((1, 3, 7), 0.4, np.float32)
        for time, ages in ((0.25, (0.0, 0.55, 0.925)), (0.75, (0.2, 1.0, 1.0))):
            expected = [by_hand([0.4] * 7, [1.0], age, curves) for age in ages]
            found = maps.at(start, time)[0], maps.height(time)[0, :, None]
            np.testing.assert_allclose(np.concatenate(found, 1), expected, atol=1e-5)

    @pytest.mark.parametrize("count", [0, 1, 4])
    def test_curves_are_rows_of_an_image(self, count: int):
        curves = some_curves(count)
        image = curves.packed()
        assert image.shape == (3 * (2 + count), AGES, 3)
        np.testing.assert_array_equal(image[0], curves.gain[:, :3])
        np.testing.assert_array_equal(image[4], curves.offset[:, 3:6])
        np.testing.assert_array_equal(image[5, :, :2], curves.offset[:, 6:])
        assert not image[2::3, :, 2].any()
        for name, values in vars(Curves.unpacked(image)).items():
            np.testing.assert_array_equal(values, getattr(curves, name))


def texels_of(change, count: int = 3000) -> AgedTexels:
    """Texels at random whose states [n, T, 7] follow from their start as `change` says, each by
    itself.
    """
    rng = torch.Generator().manual_seed(3)
    start = 0.3 + 0.4 * torch.rand(count, 7, generator=rng)
    start[:, 6] = 0.25
    palette = Palette(start, torch.arange(count))
    histories = Histories(change(palette.entries), 0.0)
    return AgedTexels(start, palette, histories, torch.ones(len(histories.states[0]), 7), None)


def fade(start: torch.Tensor) -> torch.Tensor:
    """Toward a gray, each color at its own speed: affine at every age."""
    speed = torch.tensor((0.9, 0.7, 0.5, 0.3, 0.2, 0.1, 0.0))
    share = torch.linspace(0, 1, 8)[:, None] * speed
    return start[:, None] * (1 - share) + 0.3 * share


def bend(start: torch.Tensor, bends: int) -> torch.Tensor:
    """As `fade`, and so many more ways to change, by amounts that no line over starts has."""
    states, ages = fade(start), torch.linspace(0, 1, 8)[:, None]
    for k in range(1, bends + 1):
        amount = 0.05 * torch.cos(5 * torch.pi * k * (start[:, :1] - 0.3))
        curve = torch.sin(torch.pi * k * ages) * torch.tensor((1.0, -1, 1, 0.5, 0, 0, 0))
        states = states + amount[:, None] * curve
    return states


def fitted(change, tolerance: float = 45.0):
    aged = texels_of(change)
    truth_of = partial(each_for_itself, aged, change=change)
    return aged, fit_live(aged, tolerance, truth_of), truth_of


def each_for_itself(aged: AgedTexels, start: torch.Tensor, change) -> AgedTexels:
    """Texels `start`, changed as `change` says and otherwise as `aged`."""
    own = Palette(start, torch.arange(len(start)))
    return AgedTexels(start, own, Histories(change(start), 0.0), aged.gain, None)


def as_roots(states: torch.Tensor) -> np.ndarray:
    """With sqrt(alpha) in alpha's place."""
    return torch.cat((states[:, :6], states[:, 6:].sqrt()), 1).numpy()


class TestPacking:
    def test_grain_is_as_much_below_0_as_above(self):
        image = np.full((1, 1, 4), 128 / 255, np.float32)
        found = BYTES.unpacked([image], (1, 1), 4, 3)
        np.testing.assert_allclose(found[0, 0], (128 / 255, 0, 0, 0), atol=1e-7)
        assert BYTES.unpacked([], (2, 3), 0, 0).shape == (2, 3, 0)

    def test_floats_of_earlier_are_three_to_an_image(self):
        images = [np.full((1, 1, 4), value, np.float32) for value in (0.5, -0.25)]
        found = HALVES.unpacked(images, (1, 1), 4, 1)
        np.testing.assert_array_equal(found[0, 0], (0.5, 0.5, 0.5, -0.25))


class TestFit:
    def test_what_is_affine_costs_no_coefficient(self):
        _, found, _ = fitted(fade)
        assert found is not None and found.coefficients == 0
        curves = found.sum.curves()
        assert not curves.gain[:, 7].any() and not curves.offset[:, 7].any()
        speed = np.array((0.9, 0.7, 0.5, 0.3, 0.2, 0.1))
        np.testing.assert_allclose(curves.gain[-1, :6], 1 - speed, atol=0.01)
        np.testing.assert_allclose(curves.offset[-1, :6], 0.3 * speed, atol=0.01)

    @pytest.mark.parametrize("bends", [1, 2, 3])
    def test_every_other_way_to_change_costs_one(self, bends: int):
        aged, found, truth_of = fitted(lambda start: bend(start, bends), 54.0)
        assert found is not None and found.coefficients == bends
        some = torch.arange(200, 700)
        states = found.sum.at_ages(aged.initial[some], aged.palette.index[some])
        truth = at_ages(truth_of(aged.initial[some]))
        assert min(found.error_db.values()) > 40
        for k in range(truth.shape[1]):
            shown, true = (torch.cat((y[:, k, :6], y[:, k, 6:] ** 2), -1) for y in (states, truth))
            assert appearance_psnr(true, shown) > 53

    def test_a_lower_tolerance_needs_fewer(self):
        counts = [
            found.coefficients
            for found in (fitted(lambda s: bend(s, 3), dB)[1] for dB in (20.0, 35.0, 50.0))
            if found is not None
        ]
        assert counts == sorted(counts) and counts[0] < counts[-1]

    def test_between_entries_texels_follow_a_slope(self):
        """Where entries are few, texels come nearer to their own history than one of them does."""

        def bulge(start: torch.Tensor) -> torch.Tensor:
            hump = torch.sin(torch.pi * torch.linspace(0, 1, 8))[:, None]
            return start[:, None] + 0.5 * start[:, None, :1] ** 2 * hump * (torch.arange(7) < 3)

        start = torch.linspace(0.2, 0.9, 3000)[:, None].expand(-1, 7).clone()
        palette = build_palette(start, 0.1, most=2048)
        histories = Histories(bulge(palette.entries), 0.0)
        aged = AgedTexels(start, palette, histories, torch.ones(8, 7), None)
        found = fit_live(aged, 60.0, lambda some: each_for_itself(aged, some, bulge))
        assert found is not None and len(palette.entries) < 10
        states = found.sum.at_ages(start, palette.index)
        true, composed = at_ages(each_for_itself(aged, start, bulge)), at_ages(aged)
        for k in range(4, true.shape[1] - 1):
            away, as_entry = ((y[:, k] - true[:, k]).square().mean() for y in (states, composed))
            assert away < as_entry / 4

    def test_it_starts_as_the_texel_and_nowhere_else(self):
        _, found, _ = fitted(lambda start: bend(start, 2))
        assert found is not None
        curves = found.sum.curves()
        assert (curves.gain[0, :7] == 1).all()
        assert not curves.offset[0].any() and not curves.shapes[:, 0].any()

    def test_what_is_checked_is_what_bytes_hold(self):
        aged, found, _ = fitted(lambda start: bend(start, 2))
        assert found is not None and found.coefficients > 0
        texels = aged.initial, aged.palette.index
        held = found.sum.bytes_of(*texels)
        assert (held == held.to(torch.uint8)).all()
        assert (held.amin(0) == 0).all() and (held.amax(0) == 255).all()
        curves, ages = found.sum.curves(), np.ones(len(held), np.float32)
        shown = curves.at(start=as_roots(aged.initial), coefficients=held.numpy() / 255, age=ages)
        np.testing.assert_allclose(shown, found.sum.at_ages(*texels)[:, -1], atol=1e-5)

    def test_a_texel_that_no_sample_meets_is_seen_to(self):
        def odd(start: torch.Tensor) -> torch.Tensor:
            states = fade(start)
            swing = torch.sin(torch.pi * torch.linspace(0, 1, 8))[:, None]
            return torch.where(start[:, None, :1] > 2, states + 3 * swing, states)

        aged = texels_of(odd)
        aged.initial[1234, :3] = 2.5
        palette = build_palette(aged.initial, 0.05, most=2048)
        histories = Histories(odd(palette.entries), 0.0)
        aged = AgedTexels(aged.initial, palette, histories, aged.gain, None)
        truth_of = partial(each_for_itself, aged, change=odd)
        found = fit_live(aged, 45.0, truth_of)
        assert found is not None
        spot = torch.tensor([1234])
        shown = found.sum.at_ages(aged.initial[spot], palette.index[spot])
        true = at_ages(truth_of(aged.initial[spot]))
        for k in range(true.shape[1]):
            assert appearance_psnr(true[:, k].square(), shown[:, k].square()) > 23

    def test_what_is_no_number_is_refused(self):
        aged = texels_of(fade)
        aged.histories.states[7, 3, 2] = torch.nan
        assert fit_live(aged, 45.0, partial(each_for_itself, aged, change=fade)) is None

    def test_what_no_few_shapes_make_up_is_refused(self):
        g = torch.Generator().manual_seed(0)
        table = torch.rand(2048, 8, 7, generator=g)

        def wild(start: torch.Tensor) -> torch.Tensor:
            number = (start.double().sum(1) * 1e6).long() % 2048
            return torch.cat((start[:, None], table[number, 1:]), 1)

        assert fitted(wild)[1] is None


class TestRun:
    @pytest.mark.parametrize("quality", ["draft", "balanced", "exact"])
    def test_any_moment_is_that_of_the_frames(self, quality: str, tmp_path: Path):
        source = write_painted_steel(tmp_path / "paint", 64)
        live = run(source, tmp_path / "live", quality=quality, binding="live")
        options = {"quality": "exact", "format": "torrance-sparrow", "frames": 9}
        run(source, tmp_path / "frames", **options)
        assert live["binding"] == "live" and live["coefficients"] <= live["grain"] + 1
        maps, start = read_live(tmp_path / "live"), start_of(source)
        kd, ks, alpha = (frames_of(tmp_path / "frames", name, 9) for name in TORRANCE_SPARROW)
        np.testing.assert_array_equal(maps.at(start, 0.0), start)
        for k in range(1, 9):
            true = np.concatenate((kd[k], ks[k], alpha[k][..., None]), -1).reshape(-1, 7)
            shown = as_parameters(maps.at(start, k / 8))
            least = 38 if quality == "draft" else 45
            assert appearance_psnr(torch.from_numpy(true), shown) >= least

    def test_its_files_are_those_of_the_report_and_no_other(self, paint: Path, tmp_path: Path):
        aged = run(paint, tmp_path / "out", binding="live", tolerance=50.0)
        count = aged["coefficients"]
        assert 0 < count <= 12
        names = [f"coefficients_{k}.png" for k in range((count + 3) // 4)]
        assert aged["files"] == {
            "timing": "timing.exr", "curves": "curves.exr", "coefficients": names
        }  # fmt: skip
        assert set(contents(tmp_path / "out")) == {
            "timing.exr", "curves.exr", "aged.json", *names
        }  # fmt: skip
        stored = json.loads((tmp_path / "out" / "aged.json").read_text())
        assert stored == aged
        assert stored["error_db"].keys() == {"kd", "ks", "roughness"}
        assert (len(stored["times"]), stored["format"]) == (36, "principled")
        curves = read_image(tmp_path / "out" / "curves.exr", color=True)
        assert curves.shape[0] == 3 * (2 + count)
        in_last = (count - 1) % 4 + 1
        last = read_bytes(tmp_path / "out" / names[-1])
        assert last.shape == (*aged["size"], max(3, in_last))
        assert not last[..., in_last:].any()
        assert any("The shader does the aging" in sentence for sentence in aged["plan"])

    def test_frames_turn_live_and_back_without_a_trace(self, paint: Path, tmp_path: Path):
        out = tmp_path / "out"
        fresh = {}
        for binding in ("frames", "live"):
            run(paint, tmp_path / binding, binding=binding, size=16, frames=3)
            fresh[binding] = set(contents(tmp_path / binding))
        for binding in ("frames", "live", "frames", "live"):
            run(paint, out, binding=binding, size=16, frames=3)
            assert set(contents(out)) == fresh[binding]

    def test_where_it_misses_frames_are_written_and_that_is_said(self, paint: Path, tmp_path: Path):
        said = {}
        for binding in ("live", "auto"):
            listener = Listener()
            aged = run(
                paint, tmp_path / binding, listener, binding=binding, tolerance=99.0, frames=2,
                quality="exact", size=16, ntm="fading",
            )  # fmt: skip
            assert aged["binding"] == "frames" and aged["coefficients"] == 0
            assert "error_db" not in aged
            assert (tmp_path / binding / "base_color_0002.exr").is_file()
            assert any(sentence.startswith("Wrote frames") for sentence in aged["plan"])
            said[binding] = [message for message in listener.warnings if "frames" in message]
        assert len(said["live"]) == 1 and said["auto"] == []

    def test_a_uniform_material_without_onset_is_frames(self, tmp_path: Path):
        source = write_torrance_sparrow(tmp_path / "steel")
        listener = Listener()
        aged = run(source, tmp_path / "out", listener, binding="live", onset="none", frames=2)
        assert aged["binding"] == "frames" and aged["size"] == [1, 1]
        assert not [message for message in listener.warnings if "frames" in message]

    def test_a_uniform_material_with_an_onset_needs_its_timing_alone(self, tmp_path: Path):
        source = write_torrance_sparrow(tmp_path / "steel")
        aged = run(source, tmp_path / "out", binding="live", size=32, grain=0.0)
        assert (aged["binding"], aged["coefficients"]) == ("live", 0)
        assert set(contents(tmp_path / "out")) == {"timing.exr", "curves.exr", "aged.json"}
        frames = run(source, tmp_path / "frames", size=32, frames=3, quality="exact", grain=0.0)
        live, start = read_live(tmp_path / "out"), np.empty((32, 32, 7), np.float32)
        start[:] = (0.02, 0.02, 0.02, 0.5, 0.49, 0.47, 0.1**0.5)
        assert frames["format"] == aged["format"] == "torrance-sparrow"
        kd = frames_of(tmp_path / "frames", "kd", 3)
        np.testing.assert_allclose(live.at(start, 1.0)[..., :3], kd[2], atol=0.01)

    def test_without_an_onset_the_age_is_the_time(self, paint: Path, tmp_path: Path):
        aged = run(paint, tmp_path / "out", binding="live", onset="none", size=32)
        assert "timing" not in aged["files"]
        run(paint, tmp_path / "f", onset="none", size=32, frames=5, format="torrance-sparrow")
        shown = read_live(tmp_path / "out").at(start_of(paint, 32), 0.5)
        kd, ks, alpha = (frames_of(tmp_path / "f", name, 5)[2] for name in TORRANCE_SPARROW)
        true = np.concatenate((kd, ks, alpha[..., None]), -1).reshape(-1, 7)
        assert appearance_psnr(torch.from_numpy(true), as_parameters(shown)) >= 45

    def test_the_artist_s_onset_runs_at_full_speed(self, paint: Path, tmp_path: Path):
        mask = tmp_path / "mask.exr"
        write_exr(mask, np.tile(np.linspace(0, 1, 32, dtype=np.float32), (32, 1)))
        run(paint, tmp_path / "out", binding="live", onset=str(mask), size=32)
        timing = read_image(tmp_path / "out" / "timing.exr", color=True)
        np.testing.assert_allclose(timing[..., 0], read_image(mask, color=False), atol=1e-3)
        assert (timing[..., 1] == 1).all() and (timing[..., 2] == 0).all()

    @pytest.mark.parametrize(
        ("ks", "given"), [(0.04, "principled-exact"), (0.9, "torrance-sparrow")]
    )
    def test_the_exact_mapping_is_given_up_where_it_cannot_hold_a_texel(
        self, ks: float, given: str, tmp_path: Path
    ):
        source = write_torrance_sparrow(tmp_path / "in", size=16)
        strong = np.full((16, 16, 3), 0.04, np.float32)
        strong[5, 7] = ks
        write_exr(source / "ks.exr", strong)
        listener = Listener()
        aged = run(source, tmp_path / "out", listener, binding="live", format="principled-exact")
        assert aged["binding"] == "live" and aged["format"] == given
        assert bool([m for m in listener.warnings if "exact Principled"]) == (ks > 0.8)
