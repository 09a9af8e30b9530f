"""Distances between maps by what their values are like, wherever these lie."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from training.evaluation.synthesis.statistics import (
    autocorrelation_distance,
    histogram_distance,
    map_distances,
)


class TestStatistics:
    def spots(self, seed: int, share: float, size: int = 48) -> np.ndarray:
        rng = np.random.default_rng(seed)
        y, x = np.mgrid[:size, :size]
        centers = rng.random((12, 2)) * size
        near = np.min([np.hypot(y - a, x - b) for a, b in centers], 0)
        return (near < np.quantile(near, share)).astype(np.float32)

    def test_equal_maps_are_at_no_distance(self):
        for values in (self.spots(0, 0.4), np.full((9, 9), 0.3)):
            assert histogram_distance(values, values) == 0
            assert autocorrelation_distance(values, values) == 0

    def test_histograms_know_how_far_values_moved(self):
        """Shifting all values by s moves every one by s; a mean fade of a half-covered map by 0.5
        is off by a half.
        """
        values = np.random.default_rng(0).random((40, 40))
        for shift in (0.1, 0.2, 0.4):
            assert histogram_distance(values, values + shift) == pytest.approx(shift)
        assert histogram_distance(self.spots(0, 0.5), np.full((48, 48), 0.5)) == pytest.approx(0.5)

    def test_autocorrelation_knows_coarse_from_fine(self):
        rng = np.random.default_rng(2)
        noise = rng.random((64, 64))
        coarse = np.kron(rng.random((8, 8)), np.ones((8, 8)))
        middle = np.kron(rng.random((32, 32)), np.ones((2, 2)))
        middle, coarse = ((m - m.mean()) / m.std() for m in (middle, coarse))
        noise = (noise - noise.mean()) / noise.std()
        near, far = (autocorrelation_distance(noise, other) for other in (middle, coarse))
        assert 0 < near < far

    def test_other_spots_are_nearer_than_the_fade_of_their_mean(self):
        truth, other = self.spots(1, 0.4), self.spots(2, 0.4)
        fade = np.full_like(truth, 0.4)
        assert histogram_distance(truth, other) < 0.1 * histogram_distance(truth, fade)
        assert autocorrelation_distance(truth, other) < autocorrelation_distance(truth, fade)

    def test_maps_that_do_not_exist_do_not_count(self):
        truth = torch.zeros(20, 20, 7)
        truth[..., 0] = torch.rand(20, 20)
        estimate = truth.clone()
        estimate[..., 0] += 0.5
        histogram, _ = map_distances(truth, estimate)
        alone = histogram_distance(truth[..., 0].sqrt().numpy(), estimate[..., 0].sqrt().numpy())
        assert histogram == pytest.approx(alone)
