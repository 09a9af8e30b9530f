"""How much is modeled: palettes that cover every texel, frames from which the others follow."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from model_runtime.modelling.palette import (
    Stored,
    appearance_psnr,
    build_palette,
    stored_frames,
)


def texels(n: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(n, 7, generator=torch.Generator().manual_seed(seed))


class TestPalette:
    @pytest.mark.parametrize("step", [0.4, 0.12, 0.05, 0.00625])
    def test_every_texel_is_within_a_cell_of_its_entry(self, step: float):
        """In square roots, as the eye sees and as Blender's roughness is."""
        states = texels(3000)
        palette = build_palette(states, step, most=10**9)
        apart = (states.sqrt() - palette.entries[palette.index].sqrt()).abs()
        assert float(apart.max()) <= step * 1.001
        assert palette.index.shape == (3000,)

    def test_an_entry_is_the_mean_of_its_texels(self):
        states = texels(2000)
        palette = build_palette(states, 0.3, most=10**9)
        assert len(palette.entries) < 2000
        for entry in range(0, len(palette.entries), 97):
            mean = states[palette.index == entry].double().numpy().mean(0)
            np.testing.assert_allclose(palette.entries[entry], mean, rtol=1e-6)

    def test_it_is_coarsened_until_few_enough_are_left(self):
        states = texels(5000)
        assert len(build_palette(states, 0.05, most=10**9).entries) > 300
        palette = build_palette(states, 0.05, most=300)
        assert len(palette.entries) <= 300
        assert palette.index.unique().tolist() == list(range(len(palette.entries)))

    def test_most_1(self):
        palette = build_palette(texels(100), 0.05, most=1)
        torch.testing.assert_close(palette.entries[0], texels(100).mean(0))

    def test_equal_texels_share_one_entry(self):
        states = texels(5).repeat(200, 1)
        palette = build_palette(states, 0.05, most=2048)
        assert len(palette.entries) <= 5
        torch.testing.assert_close(palette.entries[palette.index], states, rtol=1e-6, atol=1e-6)

    def test_step_0_shares_an_entry_only_between_texels_that_are_equal_to_the_last_bit(self):
        states = texels(5)
        nearly = torch.nextafter(states[:1], torch.ones(()))
        palette = build_palette(torch.cat((states, nearly, states.flip(0))), 0, most=0)
        assert torch.equal(palette.entries, torch.cat((states, nearly)))
        assert palette.index.tolist() == [0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0]

    def test_the_same_texels_in_another_order_have_the_same_palette(self):
        states, order = texels(1000), torch.randperm(1000)
        one, other = (build_palette(s, 0.1, most=10**9) for s in (states, states[order]))
        torch.testing.assert_close(one.entries, other.entries, rtol=1e-6, atol=0)
        assert torch.equal(one.index[order], other.index)

    def test_black_and_very_bright_texels(self):
        states = torch.cat((torch.zeros(3, 7), torch.full((3, 7), 4.0)))
        palette = build_palette(states, 0.05, most=2048)
        assert torch.equal(palette.entries[palette.index], states)


class TestAppearance:
    def test_equal_states_are_at_the_cap_of_100_db(self):
        assert appearance_psnr(texels(9), texels(9)) == pytest.approx(100)

    def test_diffuse_materials_by_hand(self):
        """(1 - exp(-2 Kd))^(1/2.8) of pi f = Kd, in all directions alike."""

        def shown(kd: float) -> float:
            return (1 - math.exp(-2 * kd)) ** (1 / 2.8)

        white, gray = (torch.tensor([[kd] * 3 + [0.0] * 3 + [0.5]]) for kd in (0.8, 0.4))
        expected = -20 * math.log10(shown(0.8) - shown(0.4))
        assert appearance_psnr(white, gray) == pytest.approx(expected, abs=1e-3)

    def test_farther_is_worse_and_values_out_of_range_count_as_clamped(self):
        states = texels(50)
        near, far = (appearance_psnr(states, states + d) for d in (0.001, 0.05))
        assert far < near < 100
        negative = states.clone()
        negative[:, :6] = -1
        black = states.clone()
        black[:, :6] = 0
        assert appearance_psnr(black, negative) == pytest.approx(100)

    def test_any_leading_shape(self):
        states = texels(24)
        assert appearance_psnr(states.reshape(2, 3, 4, 7), states.reshape(2, 3, 4, 7)) > 99


def rebuilt(stored: Stored, sample: np.ndarray) -> np.ndarray:
    """Every frame as the mix says, in float64."""
    return np.stack([sum(w * sample[k].astype(float) for k, w in mix) for mix in stored.mix])


def psnr(truth: np.ndarray, estimate: np.ndarray) -> float:
    error = ((truth - estimate) ** 2).mean()
    return 200.0 if error == 0 else -10 * math.log10(error)


class TestStoredFrames:
    @settings(deadline=None, max_examples=60)
    @given(
        frames=st.integers(1, 40),
        kinks=st.integers(0, 6),
        noise=st.sampled_from([0, 1e-4, 1e-2, 0.3]),
        tolerance=st.floats(20, 70),
        seed=st.integers(0, 1000),
    )
    def test_all_frames_follow_from_the_stored_ones(self, frames, kinks, noise, tolerance, seed):
        rng = np.random.default_rng(seed)
        places = np.sort(np.concatenate(((0, 1), rng.random(kinks))))
        values = rng.random((kinks + 2, 8, 3))
        times = np.linspace(0, 1, frames)
        sample = np.stack(
            [np.interp(times, places, v) for v in values.reshape(kinks + 2, -1).T], 1
        ).reshape(frames, 8, 3)
        noisy = sample + noise * rng.standard_normal(sample.shape)
        sample = noisy.clip(0).astype(np.float32)
        stored = stored_frames(torch.from_numpy(sample), tolerance)

        assert len(stored.mix) == frames
        assert list(stored.frames) == sorted(set(stored.frames))
        used = {k for mix in stored.mix for k, _ in mix}
        assert used == set(stored.frames)  # none is missing, none is written for nothing
        for mix in stored.mix:
            assert sum(weight for _, weight in mix) == pytest.approx(1)
            assert all(weight > 0 for _, weight in mix)
        for truth, estimate in zip(sample, rebuilt(stored, sample), strict=True):
            assert psnr(np.sqrt(truth), np.sqrt(estimate)) >= tolerance - 0.01
        for k in stored.frames:
            assert stored.mix[k] == ((k, 1.0),)

    def test_a_constant_keeps_one_frame(self):
        stored = stored_frames(torch.rand(1, 20, 3).expand(36, -1, -1), 45)
        assert stored.frames == (0,)
        assert stored.mix == (((0, 1.0),),) * 36

    def test_a_linear_change_keeps_two(self):
        ramp = torch.linspace(0, 1, 36)[:, None] * torch.rand(1, 20)
        assert stored_frames(ramp, 60).frames == (0, 35)

    def test_a_kink_is_kept(self):
        """The first piece reaches the kink at frame 20; across it no line would do."""
        bent = (torch.arange(36.0) - 20).clamp_min(0)[:, None] / 15
        assert stored_frames(bent.expand(36, 5), 80).frames == (0, 20, 35)

    def test_noise_keeps_everything_and_a_loose_tolerance_next_to_nothing(self):
        noise = torch.rand(30, 50)
        assert len(stored_frames(noise, 60).frames) == 30
        assert stored_frames(noise, 1).frames == (0, 29)

    def test_one_texel_that_changes_is_not_a_constant(self):
        sample = torch.zeros(10, 4000)
        sample[5:, 7] = 1
        stored = stored_frames(sample, 45)
        assert stored.frames[-1] == 9
        assert rebuilt(stored, sample.numpy())[-1, 7] == 1

    @pytest.mark.parametrize("frames", [1, 2])
    def test_few_frames(self, frames: int):
        sample = torch.rand(frames, 4)
        stored = stored_frames(sample, 45)
        assert stored.frames == tuple(range(frames))
