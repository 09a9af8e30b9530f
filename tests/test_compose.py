"""Textures from histories: the input until the onset, then the texel's difference carried on."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from model_runtime.modelling.compose import AgedTexels
from model_runtime.modelling.palette import Palette
from model_runtime.modelling.rollout import Histories
from model_runtime.temporal.pace import Timing

FRAMES = 9


def aged(
    n: int = 40,
    entries: int = 5,
    *,
    onset: torch.Tensor | None,
    rate: torch.Tensor | None = None,
    seed: int = 0,
    gain=None,
) -> AgedTexels:
    """Texels near to their entries, whose histories wander."""
    g = torch.Generator().manual_seed(seed)
    start = 0.2 + 0.5 * torch.rand(entries, 1, 7, generator=g)
    wander = 0.05 * torch.randn(entries, FRAMES, 7, generator=g)
    wander[:, 0] = 0
    states = (start + wander).clamp(0.05, 0.9)
    index = torch.randint(entries, (n,), generator=g)
    initial = states[index, 0] + 0.02 * torch.rand(n, 7, generator=g)
    if gain is None:
        gain = torch.linspace(1, 0.2, FRAMES)[:, None].expand(FRAMES, 7)
    palette, histories = Palette(states[:, 0], index), Histories(states, 0.0)
    return AgedTexels(initial, palette, histories, gain, onset, rate)


def by_hand(texels: AgedTexels, time: float) -> np.ndarray:
    """x(a) = P(a) + g(a) (x(0) - P(0)), a = rate (t - onset), texel by texel by np.interp."""
    ages = np.linspace(0, 1, FRAMES)
    result = texels.initial.double().numpy().copy()
    for k in range(len(result)):
        onset = 0.0 if texels.onset is None else float(texels.onset[k])
        if time <= onset:
            continue
        age = (time - onset) * (1.0 if texels.rate is None else float(texels.rate[k]))
        entry = texels.histories.states[texels.palette.index[k]].double().numpy()
        for c in range(7):
            history = np.interp(age, ages, entry[:, c])
            gain = np.interp(age, ages, texels.gain[:, c].double().numpy())
            result[k, c] = history + gain * (result[k, c] - entry[0, c])
    result[:, :6] = np.maximum(result[:, :6], 0)
    return result


@settings(deadline=None, max_examples=25)
@given(st.floats(0, 1), st.integers(0, 100), st.booleans(), st.booleans())
def test_the_equation(time: float, seed: int, staggered: bool, mottled: bool):
    onset, rate = torch.rand(2, 40, generator=torch.Generator().manual_seed(seed))
    texels = aged(onset=onset if staggered else None, rate=rate if mottled else None, seed=seed)
    np.testing.assert_allclose(texels.at(time), by_hand(texels, time), atol=2e-6)


def test_before_its_onset_a_texel_is_the_input_to_the_bit():
    onset = torch.linspace(0, 1, 40)
    texels = aged(onset=onset)
    for time in (0.0, 0.1, 0.5, 1.0):
        untouched = onset >= time
        now = texels.at(time)
        assert torch.equal(now[untouched], texels.initial[untouched])
        changed = (now[~untouched] != texels.initial[~untouched]).any(1)
        assert bool(changed.all())
    assert torch.equal(texels.at(0.0), texels.initial)


def test_an_onset_of_1_never_starts():
    texels = aged(onset=torch.ones(40))
    assert torch.equal(texels.at(1.0), texels.initial)


def test_a_slower_texel_is_where_a_faster_one_was():
    half = aged(onset=None, rate=torch.full((40,), 0.5))
    torch.testing.assert_close(half.at(0.8), aged(onset=None).at(0.4), rtol=1e-5, atol=1e-6)


def test_texels_without_a_time_of_their_own_show_the_mean_over_the_source_s():
    """Against each of many onsets and rates in turn."""
    timing = Timing.of(np.array((0.0, 0.25, 0.5, 0.5, 1.0)).repeat(50), np.array((0.5, 1.0)))
    texels = aged(onset=None, gain=torch.linspace(1, 0.4, FRAMES)[:, None].expand(FRAMES, 7))
    mean = texels.averaged(torch.from_numpy(timing.mean_of_ages(FRAMES)))
    torch.testing.assert_close(mean.at(0.0), texels.initial, rtol=0, atol=0)
    shares = np.linspace(0, 1, len(timing.onset))
    onsets = np.interp((np.arange(200) + 0.5) / 200, shares, timing.onset)
    for time in (0.125, 0.5, 1.0):
        each = [
            aged(onset=torch.full((40,), o), rate=torch.full((40,), r), gain=texels.gain).at(time)
            for o in onsets.tolist()
            for r in (0.5625, 0.6875, 0.8125, 0.9375)
        ]
        torch.testing.assert_close(mean.at(time), torch.stack(each).mean(0), rtol=0, atol=2e-3)


def test_the_mean_of_a_source_that_changed_at_once_is_the_history_itself():
    texels = aged(onset=None)
    mean = texels.averaged(torch.from_numpy(Timing.of(0.0).mean_of_ages(FRAMES)))
    torch.testing.assert_close(mean.at(0.7), texels.at(0.7), rtol=1e-6, atol=1e-6)


def test_without_an_onset_the_age_is_the_time():
    without, zero = aged(onset=None), aged(onset=torch.zeros(40))
    assert torch.equal(without.at(0.0), without.initial)
    for time in (0.0, 1e-3, 0.125, 0.4, 1.0):
        torch.testing.assert_close(without.at(time), zero.at(time), rtol=1e-6, atol=1e-7)


def test_at_the_modeled_ages_an_entry_follows_its_history_to_the_end():
    texels = aged(onset=None)
    texels = AgedTexels(
        texels.palette.entries,
        Palette(texels.palette.entries, torch.arange(5)),
        texels.histories,
        texels.gain,
        None,
    )
    for k in range(FRAMES):
        expected = texels.histories.states[:, k]
        torch.testing.assert_close(texels.at(k / (FRAMES - 1)), expected, rtol=1e-5, atol=1e-6)


def test_a_palette_of_one_keeps_the_texels_apart():
    """With gain 1 the history is a shift that all texels share: every detail survives."""
    texels = aged(entries=1, onset=None, gain=torch.ones(FRAMES, 7))
    shift = texels.at(0.7) - texels.initial
    torch.testing.assert_close(shift, shift[:1].expand_as(shift), rtol=1e-4, atol=1e-6)


def test_gain_0_forgets_what_lay_under():
    gain = torch.zeros(FRAMES, 7)
    gain[0] = 1
    texels = aged(entries=1, onset=None, gain=gain)
    end = texels.at(1.0)
    torch.testing.assert_close(end, texels.histories.states[:, -1].expand_as(end))


def test_results_can_be_rendered():
    texels = aged(onset=None, gain=torch.full((FRAMES, 7), 60.0))
    texels.initial[::2] -= 0.05
    end = texels.at(1.0)
    assert float(end.min()) >= 0
    assert float(np.float32(1e-4)) <= float(end[:, 6].min()) <= float(end[:, 6].max()) <= 1


def test_the_input_is_not_changed():
    texels = aged(onset=torch.rand(40))
    before = texels.initial.clone()
    texels.at(1.0)
    assert torch.equal(texels.initial, before)


def test_some_texels_are_the_same_as_among_all():
    texels = aged(onset=torch.rand(40), rate=torch.rand(40))
    rows = torch.tensor([3, 39, 0])
    for time in (0.0, 0.3, 1.0):
        assert torch.equal(texels.select(rows).at(time), texels.at(time)[rows])
    assert aged(onset=None).select(rows).onset is None


@pytest.mark.parametrize("staggered", [True, False])
def test_more_texels_than_a_chunk(staggered: bool):
    n = (1 << 17) + 3
    onset = torch.rand(n) if staggered else None
    texels = aged(n, onset=onset)
    end = texels.at(0.6)
    rows = torch.tensor([0, 1 << 16, (1 << 17) - 1, 1 << 17, n - 1])
    torch.testing.assert_close(end[rows], texels.select(rows).at(0.6))


@pytest.mark.parametrize("frames", [1, 2])
def test_short_histories(frames: int):
    states = torch.rand(2, frames, 7)
    texels = AgedTexels(
        states[:, 0].clone(),
        Palette(states[:, 0], torch.arange(2)),
        Histories(states, 0.0),
        torch.ones(frames, 7),
        torch.tensor([0.0, 0.5]),
    )
    torch.testing.assert_close(texels.at(1.0)[0], states[0, -1].clamp_min(1e-4))
    assert bool(torch.isfinite(texels.at(1.0)).all())
