"""What texels add to their histories, held against sums done by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from model_runtime.channels import ROUGHNESS_MIN
from model_runtime.modelling.compose import AgedTexels
from model_runtime.modelling.residues import HEIGHT_PLACE, Residues
from tests.test_compose import FRAMES, aged, by_hand

TIMES = (0.05, 0.3, 0.62, 1.0)


def residues(n: int = 40, *, strength: float = 0.05) -> Residues:
    """Three at random, which grow from nothing."""
    chance = torch.Generator().manual_seed(7)
    shapes = strength * torch.randn(3, FRAMES, HEIGHT_PLACE + 1, generator=chance)
    height = 0.1 * torch.randn(FRAMES, generator=chance)
    shapes[:, 0], height[0] = 0, 0
    return Residues(torch.randn(3, n, generator=chance).half(), shapes, height, 3)


def heights(texels: AgedTexels, time: float) -> np.ndarray:
    """[n], in their order."""
    band = texels.band(0, len(texels.initial))
    found = np.zeros(len(texels.initial))
    found[band.order[: band.started(time)]] = band.heights(time)
    return found


def added(texels: AgedTexels, time: float) -> np.ndarray:
    """[n, 8] that residues add, texel by texel by np.interp."""
    ages, own = np.linspace(0, 1, FRAMES), texels.residues
    assert own is not None
    found = np.zeros((len(texels.initial), HEIGHT_PLACE + 1))
    for k in range(len(found)):
        onset = 0.0 if texels.onset is None else float(texels.onset[k])
        if time <= onset:
            continue
        age = (time - onset) * (1.0 if texels.rate is None else float(texels.rate[k]))
        for g, shape in zip(own.coefficients[:, k].tolist(), own.shapes.numpy(), strict=True):
            found[k] += [g * np.interp(age, ages, curve) for curve in shape.T]
        found[k, HEIGHT_PLACE] += np.interp(age, ages, own.height.numpy())
    return found


def half_a_step(texels: AgedTexels) -> float:
    """By how much they change at most in half of the 64 steps to an age at which they are looked
    up.
    """
    own = texels.residues
    assert own is not None
    steepest = own.shapes.diff(dim=1).abs().amax((1, 2))
    largest = (own.coefficients.float().abs() * steepest[:, None]).sum(0).max()
    return float(largest + own.height.diff().abs().max()) / 128 + 1e-5


@pytest.mark.parametrize("time", TIMES)
@pytest.mark.parametrize("strength", [0.05, 3.0])
def test_they_add_to_states_with_roughness_and_to_heights(time: float, strength: float):
    onset, rate = torch.rand(2, 40, generator=torch.Generator().manual_seed(1))
    plain = aged(onset=onset, rate=rate)
    texels = replace(plain, residues=residues(strength=strength))
    expected = by_hand(plain, time)
    extra = added(texels, time)
    started = time > onset.numpy()
    reflectances = np.maximum(expected[:, :6] + extra[:, :6], 0)
    r = (np.sqrt(expected[:, 6]) + extra[:, 6]).clip(ROUGHNESS_MIN, 1)
    found = texels.at(time).numpy()
    slack = half_a_step(texels)
    np.testing.assert_allclose(found[started, :6], reflectances[started], atol=slack)
    np.testing.assert_allclose(np.sqrt(found[started, 6]), r[started], atol=slack)
    np.testing.assert_allclose(heights(texels, time), extra[:, HEIGHT_PLACE], atol=slack)


def test_before_its_onset_a_texel_is_the_input_to_the_bit():
    onset = torch.linspace(0, 1, 40)
    texels = replace(aged(onset=onset), residues=residues())
    for time in (0.0, *TIMES):
        untouched = onset >= time
        assert torch.equal(texels.at(time)[untouched], texels.initial[untouched])
        assert not heights(texels, time)[untouched.numpy()].any()


def test_means_over_a_source_s_timing_are_means_of_them_too():
    texels = replace(aged(onset=None), residues=residues())
    weights = torch.rand(FRAMES, FRAMES, generator=torch.Generator().manual_seed(2)).tril()
    weights /= weights.sum(1, keepdim=True)
    mean = texels.averaged(weights)
    ages = torch.linspace(0, 1, FRAMES).tolist()
    truth = weights.double().numpy() @ np.stack([heights(texels, age) for age in ages])
    for k, age in enumerate(ages):
        np.testing.assert_allclose(heights(mean, age), truth[k], atol=1e-5)


def test_a_part_has_the_same():
    onset = torch.rand(40, generator=torch.Generator().manual_seed(3))
    texels = replace(aged(onset=onset), residues=residues())
    rows = torch.tensor([3, 17, 5])
    some = texels.select(rows)
    np.testing.assert_array_equal(some.at(0.7), texels.at(0.7)[rows])
    np.testing.assert_array_equal(heights(some, 0.7), heights(texels, 0.7)[rows])


def test_where_there_is_little_room_the_grain_stays():
    worn = torch.linspace(0, 1, 40)
    own = residues()
    shapes = torch.cat((torch.zeros(1, FRAMES, HEIGHT_PLACE + 1), own.shapes))
    more = Residues(torch.cat((worn.half()[None], own.coefficients)), shapes, own.height, 3)
    assert more.within(4) is more
    less = more.within(3)
    assert torch.equal(less.coefficients, own.coefficients)
    assert torch.equal(less.shapes, own.shapes)
    assert torch.equal(less.height, own.height)
    least = more.within(2)
    assert least.grain == 2
    assert torch.equal(least.coefficients, own.coefficients[:2])
    assert torch.equal(least.shapes, own.shapes[:2])


def test_curves_at_other_ages_are_straight_between_their_own():
    own, ages = residues(), torch.linspace(0, 1, 33)
    found = own.shapes_at(ages), own.height_at(ages)
    known = np.linspace(0, 1, FRAMES)
    for k in range(3):
        for c in range(HEIGHT_PLACE + 1):
            truth = np.interp(ages, known, own.shapes[k, :, c])
            np.testing.assert_allclose(found[0][k, :, c], truth, atol=1e-6)
    np.testing.assert_allclose(found[1], np.interp(ages, known, own.height), atol=1e-6)
