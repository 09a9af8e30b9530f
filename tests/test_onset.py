"""Onset maps: rust spreads from spots, at a pace that holds for every seed and size."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy import ndimage

from model_runtime.temporal.onset import onset_map, rate_map
from model_runtime.temporal.pace import Timing
from training.source.onsets import correlation_length

SPREADING = ("rust", "patina", "char", "moss", "frost")  # the last is one it knows nothing of
SETTLING = ("drying", "soiling")  # through by the end
EVERYWHERE = ("fading", "yellowing")
PROCESSES = SPREADING + SETTLING + EVERYWHERE
FRAMES = {number: (number - 1) / 35 for number in range(9, 28)}  # issue 2: frames 9 to 27 of 36
TURNED_AFTER = 0.1  # a history turns visibly within a local age of 0.1


@pytest.fixture(scope="module", params=SPREADING)
def pattern(request):
    return onset_map(request.param, (256, 256), seed=5)


@pytest.mark.parametrize("process", SPREADING)
@pytest.mark.parametrize("shape", [(128, 128), (192, 320), (512, 512)])
@pytest.mark.parametrize("seed", [0, 1, 2024])
def test_a_fifth_is_untouched_and_a_fifth_has_turned_through_the_middle(process, shape, seed):
    onset = onset_map(process, shape, seed=seed)
    for number, t in FRAMES.items():
        assert np.mean(onset >= t) >= 0.2, f"frame {number}"
        assert np.mean(onset <= t - TURNED_AFTER) >= 0.2, f"frame {number}"


@pytest.mark.parametrize("process", PROCESSES)
def test_frame_one_is_untouched_and_every_texel_starts(process):
    onset = onset_map(process, (128, 128), seed=5)
    assert onset.dtype == np.float32
    assert onset.min() > 0
    assert onset.max() < 1


@pytest.mark.parametrize("process", SETTLING)
def test_what_settles_or_dries_is_through_by_the_end(process):
    onset = onset_map(process, (128, 128), seed=5)
    assert np.ptp(onset) > 0.5
    assert onset.max() < 0.75


@pytest.mark.parametrize("process", EVERYWHERE)
def test_light_and_air_reach_everything_at_about_the_same_time(process):
    onset, rate = (f(process, (128, 128), seed=5) for f in (onset_map, rate_map))
    assert 0.1 < np.ptp(onset) < 0.15
    assert max(np.abs(np.diff(onset, axis=axis)).max() for axis in (0, 1)) < 0.02  # a gradient
    assert rate.min() > 0.7


def test_the_border_moves_in_every_frame(pattern):
    shares = [np.mean(pattern <= t) for t in FRAMES.values()]
    assert np.diff(shares).min() > 0.01


def test_it_spreads_instead_of_appearing_everywhere(pattern):
    """What turns within a frame lies mostly within 5 texels (2 %) of what had turned before."""
    near, new = 0, 0
    for t in FRAMES.values():
        before, after = pattern <= t, pattern <= t + 1 / 35
        reached = np.asarray(ndimage.binary_dilation(np.pad(before, 8, mode="wrap"), iterations=5))
        near += np.count_nonzero(reached[8:-8, 8:-8] & after & ~before)
        new += np.count_nonzero(after & ~before)
    assert near > 0.85 * new


def test_each_process_has_its_own_way_to_spread():
    def early_spots(process: str) -> int:
        labels = np.zeros((256, 256), np.int32)
        ndimage.label(onset_map(process, (256, 256), seed=1) < 0.1, output=labels)
        return int(labels.max())

    assert early_spots("rust") > 40  # rust nucleates in many places,
    assert early_spots("char") < early_spots("rust") / 2  # fire starts in few

    assert 8 < early_spots("moss") < early_spots("rust")  # and spores in some

    for process in ("patina", "soiling"):
        streaks = onset_map(process, (256, 256), seed=1)
        along, across = (np.abs(np.diff(streaks, axis=axis)).mean() for axis in (0, 1))
        assert along < across / 2  # both run down


@pytest.mark.parametrize("process", PROCESSES)
def test_a_small_map_is_the_large_one_from_further_away(process):
    large = onset_map(process, (512, 512), seed=3)
    small = onset_map(process, (256, 256), seed=3)
    averaged = large.reshape(256, 2, 256, 2).mean((1, 3))
    assert np.corrcoef(small.ravel(), averaged.ravel())[0, 1] > 0.98
    assert np.abs(small - averaged).mean() < 0.035  # about a frame of 36


@pytest.mark.parametrize("process", PROCESSES)
@pytest.mark.parametrize("axis", [0, 1])
def test_the_tile_wraps_without_a_seam(process, axis):
    def step_at_edge(onset: np.ndarray) -> float:
        edge = np.abs(np.take(onset, 0, axis) - np.take(onset, -1, axis)).mean()
        return edge / np.abs(np.diff(onset, axis=axis)).mean()

    assert step_at_edge(onset_map(process, (256, 192), seed=2)) < 2
    open_map = onset_map(process, (256, 192), seed=2, tileable=False)
    assert step_at_edge(open_map) > 4


def test_the_seed_decides():
    first, again, other = (onset_map("rust", (64, 64), seed=s) for s in (7, 7, 8))
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)
    assert not np.allclose(first, onset_map("char", (64, 64), seed=7))


class TestTiming:
    """Of a source: its pace and scale, in the process's own pattern."""

    @pytest.mark.parametrize("process", PROCESSES)
    @pytest.mark.parametrize("shape", [(96, 96), (80, 200)])
    def test_the_pace_and_the_mottling_are_the_source_s(self, process, shape):
        rng = np.random.default_rng(6)
        onset, rate = rng.beta(0.6, 1.5, 5000), rng.uniform(0.3, 1, 5000)
        timing = Timing.of(onset, rate)
        for make, source in ((onset_map, onset), (rate_map, rate)):
            made = make(process, shape, seed=1, timing=timing)
            assert made.shape == shape and made.dtype == np.float32
            shares = np.linspace(0.01, 0.99, 50)
            expected, found = np.quantile(source, shares), np.quantile(made, shares)
            np.testing.assert_allclose(found, expected, atol=0.03)  # between 33 quantiles

    @pytest.mark.parametrize("process", PROCESSES)
    def test_that_of_a_pattern_of_ours_makes_the_pattern_again(self, process):
        onset, rate = (make(process, (128, 128), seed=4) for make in (onset_map, rate_map))
        timing = Timing.of(onset, rate)
        again = onset_map(process, (128, 128), seed=4, timing=timing)
        np.testing.assert_allclose(again, onset, atol=0.01)
        mottled = rate_map(process, (128, 128), seed=4, timing=timing)
        np.testing.assert_allclose(mottled, rate, atol=0.04)

    @pytest.mark.parametrize("process", PROCESSES)
    def test_the_scale_is_the_source_s(self, process):
        """Within two fifths on average over seeds, which differ by a third."""

        def length(scale: float) -> float:
            timing = Timing.of(np.linspace(0, 1, 99), scale=scale)
            maps = (onset_map(process, (160, 160), seed=s, timing=timing) for s in range(6))
            return float(np.mean([correlation_length(onset) or 0.0 for onset in maps]))

        assert length(0.1) == pytest.approx(0.1, rel=0.4)
        assert length(0.05) == pytest.approx(0.05, rel=0.4)

    @pytest.mark.parametrize("scale", [1e-4, 0.03, 1.0])
    def test_any_scale_tiles(self, scale):
        onset = onset_map(
            "moss", (96, 96), seed=2, timing=Timing.of(np.linspace(0, 1, 9), scale=scale)
        )
        for axis in (0, 1):
            inside = np.abs(np.diff(onset, axis=axis)).mean()
            edge = np.abs(np.take(onset, 0, axis) - np.take(onset, -1, axis)).mean()
            assert edge < 2 * inside

    def test_all_at_once_is_no_pattern(self):
        at_once = Timing.of(0.0)
        assert (onset_map("rust", (16, 9), seed=0, timing=at_once) == 0).all()
        assert (rate_map("rust", (16, 9), seed=0, timing=at_once) == 1).all()

    def test_a_single_texel_starts_at_once_and_runs_at_full_speed(self):
        late = Timing.of(0.8, 0.3)
        assert onset_map("rust", (1, 1), seed=0, timing=late) == 0
        assert rate_map("rust", (1, 1), seed=0, timing=late) == 1


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (3, 7), (4, 512)])
def test_any_shape_works(shape):
    onset = onset_map("rust", shape, seed=0)
    assert onset.shape == shape
    assert np.isfinite(onset).all()
    assert onset.min() >= 0
    assert onset.max() <= 1


def test_a_single_texel_starts_at_once():
    """Uniform materials have no pattern to speak of."""
    assert onset_map("rust", (1, 1), seed=4) == 0


@pytest.mark.parametrize("process", PROCESSES)
def test_a_megatexel_takes_less_than_a_second_of_one_core(process):
    started = time.process_time()
    onset_map(process, (1024, 1024), seed=1)
    assert time.process_time() - started < 1.0
