"""What an NTM learns from: histories counted from every texel's own onset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.random_histories import histories_of, random_maps
from training.data.sequences import Sequence
from training.data.synthetic import s2
from training.source.histories import align, source_histories


class TestAlign:
    """Three texels at times 0, 1/4, .. 1; each holds its state until its onset, then rises by 1
    per unit of time.
    """

    times = np.linspace(0, 1, 5, dtype=np.float32)

    def states(self, onset: np.ndarray) -> torch.Tensor:
        rise = np.maximum(0, self.times[:, None] - onset)
        return torch.from_numpy((rise[..., None] + [10, 20]).astype(np.float32))

    def test_by_hand(self):
        onset = np.array((0, 0.25, 0.75), np.float32)
        histories, observed = align(self.states(onset), self.times, onset)
        assert histories.shape == (3, 5, 2)
        expected = [
            [0, 0.25, 0.5, 0.75, 1],
            [0, 0.25, 0.5, 0.75, 0.75],  # the sequence ends, its last frame is repeated
            [0, 0.25, 0.25, 0.25, 0.25],
        ]
        np.testing.assert_allclose(histories[..., 0], 10 + np.array(expected), rtol=1e-6)
        np.testing.assert_allclose(histories[..., 1], 20 + np.array(expected), rtol=1e-6)
        assert observed.tolist() == [[True] * 5, [True] * 4 + [False], [True] * 2 + [False] * 3]

    def test_onset_between_two_frames(self):
        """At onset 3/8, ages 1/4 and 1/2 lie halfway between frames: linear in between."""
        onset = np.array([0.375], np.float32)
        histories, observed = align(self.states(onset), self.times, onset)
        np.testing.assert_allclose(histories[0, :, 0], (10, 10.25, 10.5, 10.625, 10.625), rtol=1e-6)
        assert observed[0].tolist() == [True, True, True, False, False]

    def test_uneven_times(self):
        """The ages are even all the same: 0, 1/2, 1."""
        times = np.array((0, 0.2, 1), np.float32)
        states = torch.tensor([[[0.0]], [[0.2]], [[1.0]]])
        histories, observed = align(states, times, np.zeros(1))
        np.testing.assert_allclose(histories[0, :, 0], (0, 0.5, 1), rtol=1e-6)
        assert bool(observed.all())

    def test_a_texel_that_never_starts_is_seen_at_age_0_alone(self):
        histories, observed = align(self.states(np.ones(1)), self.times, np.ones(1))
        assert observed[0].tolist() == [True] + [False] * 4
        assert bool((histories[0, :, 0] == 10).all())

    @settings(deadline=None, max_examples=30)
    @given(st.floats(0, 1), st.integers(2, 40))
    def test_the_first_entry_is_the_first_frame_and_nothing_is_extrapolated(
        self, onset: float, frames: int
    ):
        times = np.linspace(0, 1, frames, dtype=np.float32)
        states = torch.rand(frames, 1, 3)
        histories, observed = align(states, times, np.array([onset]))
        assert torch.equal(histories[0, 0], states[0, 0])
        assert bool((histories.amin(1) >= states.amin(0)).all())
        assert bool((histories.amax(1) <= states.amax(0) + 1e-6).all())
        ages = np.linspace(0, 1, frames)
        clear = abs(onset + ages - 1) > 1e-5
        assert (observed[0].numpy() == (onset + ages <= 1))[clear].all()


class _Plain:
    """A representation whose latents are the values themselves at three directions."""

    def sample_angles(self, m: int) -> torch.Tensor:
        return torch.tensor([[0.1, 0.1, 0.0], [0.4, 0.2, 1.0], [0.9, 0.3, 2.0]])

    def encode(self, angles, f):
        from model_runtime.representation.latents import Latents

        return Latents(f.transpose(1, 2), f.mean(-1))


def test_histories_of_a_sequence_hold_parameters_and_latents():
    from model_runtime.brdf.torrance_sparrow import evaluate

    sequence = s2(random_maps(3, 1), 0.5, frames=4)
    source = source_histories(sequence, _Plain())
    torch.testing.assert_close(source.parameters, histories_of(sequence.clamped()))
    assert source.latents.shape == (9, 4, 12)
    lost = ((histories_of(sequence) - source.parameters).abs() > 1e-6).any(-1)
    assert 0 < lost.sum() < lost.numel(), "S2 drives some Ks below 0, which no fit may learn from"
    assert torch.equal(source.observed, ~lost)
    assert source.out_of_range == pytest.approx(float(lost.float().mean()))
    state = source.parameters[5, 2]
    f = evaluate(state[None, :3], state[None, 3:6], state[None, 6], _Plain().sample_angles(3))[0]
    torch.testing.assert_close(source.latents[5, 2, :9], f.T.reshape(-1))
    part = source.select(torch.tensor([5]))
    assert torch.equal(part.parameters[0], source.parameters[5])


def test_a_large_sequence_is_drawn_from_with_the_onset_of_the_same_texels():
    size = 100
    rng = np.random.default_rng(0)
    onset = rng.choice((0.0, 0.5), (size, size)).astype(np.float32)
    times = np.linspace(0, 1, 3, dtype=np.float32)
    rise = np.maximum(0, times[:, None, None] - onset)
    kd = np.repeat(rise[..., None], 3, -1).astype(np.float32)
    sequence = Sequence(kd, np.zeros_like(kd), rise / 2 + np.float32(0.1), times, onset, "made up")
    source = source_histories(sequence, _Plain(), seed=1)
    assert len(source.parameters) == 8192
    late = ~source.observed[:, 2]
    assert 0.4 < float(late.float().mean()) < 0.6
    torch.testing.assert_close(
        source.parameters[late, 1, 0], torch.full((int(late.sum()),), 0.5), rtol=0, atol=1e-6
    )
    again = source_histories(replace(sequence), _Plain(), seed=1)
    assert torch.equal(again.parameters, source.parameters)
