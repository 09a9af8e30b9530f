"""Timing: told apart from the change itself where a sequence has one, and nowhere else; its
statistics, and the mean over it.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from model_runtime.temporal.pace import Timing
from training.data.sequences import MixtureSequence, Sequence, uniform_times
from training.data.synthetic import from_pbr, s1, s2
from training.data.weathering import generate
from training.evaluation.synthesis.cases import PBR, spots
from training.source.onsets import correlation_length, estimate_onset, timed

STARTED_APART = ("rust", "patina", "char", "drying", "soiling", "moss")
STARTED_TOGETHER = ("fading", "yellowing")  # within an eighth of the time
PATCH = (slice(0, 64), slice(0, 64))


def shown(sequence: Sequence) -> Sequence:
    """Without what it says of its timing."""
    return replace(sequence, onset=None, timing=None)


def alike(onset: np.ndarray, truth: np.ndarray) -> float:
    return float(np.corrcoef(onset.ravel(), truth.ravel())[0, 1])


def gray(alpha: np.ndarray) -> Sequence:
    """A sequence [T, H, W] whose Kd and alpha are the same."""
    kd = np.repeat(alpha[..., None], 3, -1).astype(np.float32)
    times = uniform_times(len(alpha))
    return Sequence(kd, np.zeros_like(kd), alpha.astype(np.float32), times, None, "made up")


class TestEstimate:
    @pytest.mark.parametrize("process", STARTED_APART)
    def test_a_hidden_onset_is_found(self, process: str):
        sequence = generate(process, size=64, seed=3)
        assert sequence.onset is not None
        onset = estimate_onset(shown(sequence))
        assert onset is not None and onset.shape == (64, 64) and onset.dtype == np.float32
        assert alike(onset, sequence.onset) > 0.99
        assert np.abs(onset - sequence.onset).mean() < 1 / 35  # a frame

    def test_spots_of_which_the_first_frame_says_nothing(self, data_folder: Path):
        sequence = spots(from_pbr(data_folder / "pbr" / "Metal032", PATCH), seed=1)
        onset = estimate_onset(shown(sequence))
        assert onset is not None and sequence.onset is not None
        assert alike(onset, sequence.onset) > 0.99

    @pytest.mark.parametrize("process", STARTED_TOGETHER)
    def test_what_the_first_frame_tells_is_no_timing(self, process: str):
        """Dyes and varnishes differ in their histories, but not in when these start."""
        assert estimate_onset(shown(generate(process, size=64, seed=3))) is None

    @pytest.mark.parametrize("material", PBR)
    def test_the_paper_s_models_change_everywhere_at_once(self, data_folder: Path, material: str):
        start = from_pbr(data_folder / "pbr" / material, PATCH)
        for sequence in (s1(start, 0.6), s1(start, 1.0), s2(start, 0.6), s2(start, 1.0)):
            assert estimate_onset(sequence) is None

    def test_it_takes_seconds(self):
        rng = np.random.default_rng(0)
        onset = gaussian_filter(rng.random((300, 300)), 10, mode="wrap")
        onset = (onset - onset.min()) / np.ptp(onset)
        rise = np.clip(uniform_times(36)[:, None, None] - onset, 0, 1)
        started = time.process_time()
        found = estimate_onset(gray(0.1 + 0.5 * rise))
        assert time.process_time() - started < 20
        assert found is not None and alike(found, onset) > 0.9

    def test_a_seed_decides_and_hardly_matters(self):
        sequence = shown(generate("rust", size=48, seed=1))
        first, again, other = (estimate_onset(sequence, seed=s) for s in (1, 1, 2))
        assert first is not None and again is not None and other is not None
        np.testing.assert_array_equal(first, again)
        assert np.abs(first - other).mean() < 1 / 35

    @pytest.mark.parametrize(
        "alpha",
        [
            np.full((9, 8, 8), 0.3),
            np.linspace(0.1, 0.9, 9)[:, None, None] * np.ones((1, 1, 1)),
            np.linspace(0.1, 0.9, 2)[:, None, None] * np.ones((1, 8, 8)),
            np.linspace(0.1, 0.9, 9)[:, None, None] * np.ones((1, 8, 8)),
            np.zeros((9, 8, 8)),  # never to be rendered: nothing is seen
        ],
        ids=["constant", "one texel", "two frames", "uniform", "out of range"],
    )
    def test_where_there_is_nothing_to_tell_there_is_none(self, alpha: np.ndarray):
        assert estimate_onset(gray(alpha)) is None

    def test_texels_that_never_start(self):
        """Half of them jump at mid-time."""
        alpha = np.full((21, 10, 10), 0.1)
        alpha[10:, :5] = 0.6
        onset = estimate_onset(gray(alpha))
        assert onset is not None
        assert np.abs(onset[:5] - 0.45).max() < 0.06
        assert onset[5:].min() >= 0.95


class TestTimed:
    def test_what_a_sequence_brings_is_kept(self):
        sequence = generate("moss", size=32, frames=6)
        kept = timed(sequence)
        assert isinstance(kept, Sequence)
        assert kept.onset is sequence.onset and kept.timing is sequence.timing

    def test_the_statistics_of_an_onset_are_measured(self):
        rng = np.random.default_rng(1)
        onset = gaussian_filter(rng.random((64, 64)), 3, mode="wrap").astype(np.float32)
        sequence = timed(replace(gray(np.full((6, 64, 64), 0.3)), onset=onset))
        assert isinstance(sequence, Sequence) and sequence.timing is not None
        np.testing.assert_allclose(sequence.timing.onset[16], np.median(onset), atol=1e-4)
        assert set(sequence.timing.rate) == {1.0}
        assert sequence.timing.scale == pytest.approx(5 / 64, rel=0.15)

    def test_without_a_timing_everything_starts_at_once(self):
        sequence = timed(gray(np.full((6, 4, 4), 0.3)))
        assert isinstance(sequence, Sequence) and sequence.timing is not None
        assert sequence.onset is None
        assert sequence.timing.at_once

    def test_mixtures_have_none(self):
        weights = np.zeros((5, 4, 4), np.float32)
        mixture = MixtureSequence(("a", "b"), weights, uniform_times(5), "made up")
        assert timed(mixture) is mixture


class TestCorrelationLength:
    @pytest.mark.parametrize("sigma", [3.0, 6.0])
    @pytest.mark.parametrize("shape", [(256, 256), (128, 256)])
    def test_of_smoothed_noise(self, sigma: float, shape: tuple[int, int]):
        """White noise under a Gaussian: exp(-d^2 / 4 sigma^2) falls to a half at 2 sigma
        sqrt(ln 2).
        """
        noise = gaussian_filter(np.random.default_rng(2).standard_normal(shape), sigma)
        expected = 2 * sigma * np.sqrt(np.log(2)) / 256
        assert correlation_length(noise) == pytest.approx(expected, rel=0.12)

    def test_of_noise_it_is_less_than_a_texel_and_of_a_gradient_the_longest(self):
        noise = np.random.default_rng(2).standard_normal((64, 64))
        assert correlation_length(noise) == pytest.approx(0.5 / 64, rel=0.1)
        assert correlation_length(np.mgrid[:64, :64][0] / 64) == pytest.approx(0.25, rel=0.1)

    @pytest.mark.parametrize("shape", [(1, 1), (1, 9), (40, 40)])
    def test_of_what_does_not_vary_there_is_none(self, shape: tuple[int, int]):
        assert correlation_length(np.full(shape, 0.7)) is None


class TestStatistics:
    def test_json_and_back(self):
        timing = Timing.of(np.random.default_rng(0).random((5, 6)), 0.5, scale=0.123456)
        assert Timing.from_json(timing.json()) == timing
        assert timing.scale == 0.1235

    @pytest.mark.parametrize(
        "change",
        [
            {"onset": [0.0] * 32},
            {"onset": [0.0] * 100_000},
            {"onset": "0" * 33},
            {"onset": [0.5, *[0.2] * 32]},
            {"onset": [*[0.0] * 32, 1.5]},
            {"onset": [-0.1, *[0.0] * 32]},
            {"onset": [*[0.0] * 32, float("nan")]},
            {"onset": [*[0.0] * 32, True]},
            {"onset": None},
            {"rate": [0.0] * 33},
            {"rate": [*[0.5] * 32, float("inf")]},
            {"scale": 0},
            {"scale": 2.0},
            {"scale": float("nan")},
            {"scale": "wide"},
            {"more": 1},
        ],
        ids=lambda change: str(change)[:40],
    )
    def test_what_is_no_timing_is_refused(self, change: dict[str, Any]):
        good = Timing.of(0.25, scale=0.1).json()
        with pytest.raises(ValueError, match=r"timing|rate"):
            Timing.from_json({**good, **change})
        with pytest.raises(ValueError, match="timing"):
            Timing.from_json([good])

    def test_the_mean_is_the_identity_where_everything_starts_at_once(self):
        for frames in (2, 21, 36):
            np.testing.assert_array_equal(Timing.of(0.0).mean_of_ages(frames), np.eye(frames))

    @settings(deadline=None, max_examples=20)
    @given(st.integers(0, 1000), st.integers(2, 40))
    def test_the_mean_over_many_texels(self, seed: int, frames: int):
        """Against texels drawn one by one."""
        rng = np.random.default_rng(seed)
        onset, rate = rng.beta(0.7, 0.9, 20_000), rng.uniform(0.2, 1, 20_000)
        weights = Timing.of(onset, rate).mean_of_ages(frames)
        np.testing.assert_allclose(weights.sum(1), 1, rtol=1e-5)
        assert weights.min() >= 0
        ages = np.linspace(0, 1, frames)
        history = ages**2
        for k in (0, frames // 2, frames - 1):
            age = rate * np.maximum(0, ages[k] - onset)
            expected = np.interp(age, ages, history).mean()
            assert weights[k] @ history == pytest.approx(expected, abs=0.006)

    def test_a_constant_delay(self):
        weights = torch.from_numpy(Timing.of(0.5).mean_of_ages(5))
        expected = torch.zeros(5, 5)
        expected[range(5), [0, 0, 0, 1, 2]] = 1
        torch.testing.assert_close(weights, expected)
