"""The rivals STT and STAF, against histories whose polynomials or factors are known beforehand."""

from __future__ import annotations

import numpy as np
import pytest

from model_runtime.errors import InputError
from model_runtime.maps import TorranceSparrowMaps
from training.baselines import staf, stt
from training.data.sequences import Sequence, uniform_times
from training.data.synthetic import S1_DELTA, from_pbr, offset, s1, s2

SIZE = (12, 16)


def sequence(values: np.ndarray, times: np.ndarray) -> Sequence:
    """A sequence of values [T, H, W, 7]: kd, ks, alpha."""
    values = values.astype(np.float32)
    kd, ks, alpha = values[..., :3], values[..., 3:6], values[..., 6]
    return Sequence(kd, ks, alpha, times.astype(np.float32), None, "known")


def cubics(times: np.ndarray, seed: int = 0) -> Sequence:
    """A cubic of its own for every texel and channel, each beginning between 0.2 and 0.6."""
    random = np.random.default_rng(seed)
    c0 = random.uniform(0.2, 0.6, (*SIZE, 7))
    c1, c2, c3 = random.uniform(-0.5, 0.5, (3, *SIZE, 7))
    return sequence(np.stack([c0 + c1 * t + c2 * t**2 + c3 * t**3 for t in times]), times)


def phi(t: np.ndarray) -> np.ndarray:
    """Slow, then fast, then slow: a curve on which time can be told from amount."""
    return 3 * t**2 - 2 * t**3


def factorised(times: np.ndarray, seed: int = 0) -> tuple[Sequence, np.ndarray]:
    """A phi(R t - O) + D with random factors for every texel and channel; and R [H, W, 7]."""
    random = np.random.default_rng(seed)
    a = random.uniform(0.1, 0.4, (*SIZE, 7)) * random.choice((-1, 1), (*SIZE, 7))
    r = random.uniform(0.8, 1.3, (*SIZE, 7))
    o = random.uniform(-0.1, 0.2, (*SIZE, 7))
    d = random.uniform(0.2, 0.6, (*SIZE, 7))
    return sequence(np.stack([a * phi(r * t - o) + d for t in times]), times), r


def first_frame(source: Sequence) -> TorranceSparrowMaps:
    return TorranceSparrowMaps(source.kd[0], source.ks[0], source.alpha[0])


def other_maps(size: tuple[int, int], seed: int = 9) -> TorranceSparrowMaps:
    values = np.random.default_rng(seed).uniform(0.1, 0.5, (*size, 7)).astype(np.float32)
    return TorranceSparrowMaps(values[..., :3], values[..., 3:6], values[..., 6])


def stacked(history: Sequence) -> np.ndarray:
    """[T, H, W, 7]."""
    return np.concatenate((history.kd, history.ks, history.alpha[..., None]), -1)


def assert_same(estimate: Sequence, truth: np.ndarray, tolerance: float) -> None:
    np.testing.assert_allclose(stacked(estimate), truth, rtol=0, atol=tolerance)


def relative_error(estimate: Sequence, truth: Sequence) -> float:
    """RMS error over RMS change."""
    change = stacked(truth) - stacked(truth)[:1]
    error = stacked(estimate) - stacked(truth)
    return float(np.sqrt(np.square(error).mean() / np.square(change).mean()))


def test_stt_gives_the_source_back_where_its_histories_are_cubic():
    source = cubics(uniform_times(36))
    again = stt.fit(source).synthesize(first_frame(source), source.times)
    assert_same(again, stacked(source), 1e-6)
    assert again.onset is None


def test_stt_gives_the_source_back_at_times_it_has_no_frame_for():
    finer = cubics(np.linspace(0, 1, 21))
    coarse = cubics(np.array((0.0, 0.1, 0.45, 0.7, 1.0)))
    estimate = stt.fit(coarse).synthesize(first_frame(coarse), finer.times)
    assert_same(estimate, stacked(finer), 2e-6)


def test_stt_gives_the_least_squares_cubic_of_any_other_source():
    source = factorised(uniform_times(20))[0]
    source = sequence(np.exp(2 * stacked(source)), source.times)
    flat = stacked(source).reshape(20, -1).astype(float)
    best = np.polynomial.polynomial.polyfit(source.times, flat, 3)
    expected = np.polynomial.polynomial.polyval(source.times, best).T.reshape(20, *SIZE, 7)
    again = stt.fit(source).synthesize(first_frame(source), source.times)
    assert_same(again, expected, 1e-5)


def test_stt_scales_the_diffuse_history_alone():
    source = cubics(uniform_times(8))
    start = first_frame(source)
    dimmer = TorranceSparrowMaps(start.kd / 2, start.ks / 3, start.alpha / 3)
    estimate = stt.fit(source).synthesize(dimmer, source.times)
    np.testing.assert_allclose(estimate.kd, source.kd / 2, atol=1e-6)
    np.testing.assert_allclose(estimate.ks, source.ks, atol=1e-6)
    np.testing.assert_allclose(estimate.alpha, source.alpha, atol=1e-6)


def test_stt_does_not_divide_by_black():
    source = cubics(uniform_times(8))
    source.kd[0, 3, 4] = 0
    gray = TorranceSparrowMaps(*(stacked(source)[0, ..., s] for s in (slice(3), slice(3, 6), 6)))
    gray.kd[3, 4] = 1e-4
    estimate = stt.fit(source).synthesize(gray, source.times)
    assert np.isfinite(estimate.kd).all()
    assert np.abs(estimate.kd).max() < 2


def test_stt_finds_the_patch_where_it_lies():
    """In a target of the source moved by (3, 5) and laid side by side, all but the seams."""
    source = cubics(uniform_times(8))
    moved = np.roll(stacked(source), (3, 5), (1, 2))
    moved = np.concatenate((moved, moved), 2)
    target = first_frame(sequence(moved, source.times))
    estimate = stacked(stt.fit(source).synthesize(target, source.times))
    for columns in (slice(7, 14), slice(23, 30)):
        inside = np.s_[:, 5:10, columns]
        np.testing.assert_allclose(estimate[inside], moved[inside], atol=1e-6)


def test_staf_gives_the_source_back_where_it_has_its_form():
    source, _ = factorised(uniform_times(36))
    again = staf.fit(source).synthesize(first_frame(source), source.times)
    assert_same(again, stacked(source), 1e-4)
    assert again.onset is None


def test_staf_finds_the_rates_in_its_own_gauge():
    source, rates = factorised(uniform_times(36))
    for channel, factors in enumerate(staf.fit(source).parameters):
        expected = rates[..., channel] / np.median(rates[..., channel])
        np.testing.assert_allclose(factors.rate, expected, rtol=0.01)
        assert factors.phi(0.0) == pytest.approx(0, abs=1e-9)
        assert np.abs(factors.phi(np.linspace(0, 1, 65))).max() == pytest.approx(1)


def test_staf_adds_the_change_of_the_same_place_to_any_target():
    """A phi(R t - O) + target - A phi(-O) is the target plus what the source gained since t = 0."""
    source, _ = factorised(uniform_times(36))
    size = (SIZE[0] + 5, SIZE[1] - 4)
    target = other_maps(size)
    gained = np.tile(stacked(source) - stacked(source)[:1], (1, 2, 2, 1))[:, : size[0], : size[1]]
    start = np.dstack((target.kd, target.ks, target.alpha))
    assert_same(staf.fit(source).synthesize(target, source.times), start + gained, 2e-4)


def test_staf_is_not_misled_by_texels_that_do_something_else():
    source, _ = factorised(uniform_times(36))
    values = stacked(source)
    values[:, :2, :5] += np.random.default_rng(1).normal(0, 0.5, (36, 2, 5, 7)).astype(np.float32)
    again = staf.fit(sequence(values, source.times)).synthesize(first_frame(source), source.times)
    sound = np.s_[:, 2:]
    np.testing.assert_allclose(stacked(again)[sound], stacked(source)[sound], atol=0.01)


@pytest.mark.parametrize("method", [stt, staf])
def test_what_does_not_change_stays(method):
    start = other_maps(SIZE)
    still = np.repeat(np.dstack((start.kd, start.ks, start.alpha))[None], 6, 0)
    source = sequence(still, uniform_times(6))
    assert_same(method.fit(source).synthesize(start, source.times), still, 1e-6)


@pytest.mark.parametrize("model", [s1, s2])
@pytest.mark.parametrize("method", [stt, staf])
def test_both_follow_the_papers_synthetic_models_on_their_own_source(method, model, data_folder):
    patch = (slice(0, 24), slice(0, 24))
    for name in ("Wood049", "PaintedMetal007"):
        initial = from_pbr(data_folder / "pbr" / name, patch)
        source = model(initial, 0.8)
        estimate = method.fit(source).synthesize(initial, source.times)
        assert relative_error(estimate, source) < (0.01 if model is s1 else 1e-5)


def test_stt_keeps_the_roughness_of_the_source_and_staf_that_of_the_target(data_folder):
    """What the paper faults STT with, section 4.3; the roughness of S2 grows in proportion."""
    initial = from_pbr(data_folder / "pbr" / "Wood049", (slice(0, 24), slice(0, 24)))
    source = s2(initial, 0.6)
    rougher = offset(initial, delta=(0, 0, 0), beta=0.2)
    truth = s2(rougher, 0.6)

    transferred = stt.fit(source).synthesize(rougher, source.times)
    np.testing.assert_allclose(transferred.alpha, source.alpha, atol=1e-5)
    # alpha(1) = (0.25 x 0.6 + 0.5 x 1.6 + 1) alpha(0) = 1.95 alpha(0), and the target began 0.2 up
    np.testing.assert_allclose(truth.alpha[-1] - transferred.alpha[-1], 1.95 * 0.2, atol=1e-3)

    factored = staf.fit(source).synthesize(rougher, source.times)
    np.testing.assert_allclose(factored.alpha[0], rougher.alpha, atol=1e-6)
    np.testing.assert_allclose(truth.alpha[-1] - factored.alpha[-1], 0.95 * 0.2, atol=1e-3)


@pytest.mark.parametrize("method", [stt, staf])
def test_they_run_unclamped_and_alike_each_time(method):
    source = s2(other_maps(SIZE), 1.0)
    target = offset(other_maps(SIZE, seed=3), delta=S1_DELTA, beta=0.5)
    first, second = (method.fit(source).synthesize(target, source.times) for _ in range(2))
    assert first.out_of_range().any()
    np.testing.assert_array_equal(stacked(first), stacked(second))


@pytest.mark.parametrize("method", [stt, staf])
def test_a_source_of_three_frames_is_refused(method):
    with pytest.raises(InputError, match=r"only 3 frames\. Give it at least four\."):
        method.fit(cubics(uniform_times(3)))


@pytest.mark.parametrize("method", [stt, staf])
def test_four_frames_are_enough(method):
    source = cubics(uniform_times(4)) if method is stt else factorised(uniform_times(4))[0]
    again = method.fit(source).synthesize(first_frame(source), source.times)
    assert relative_error(again, source) < 0.01


def test_maps_smaller_than_a_patch_are_refused_by_stt():
    model = stt.fit(cubics(uniform_times(6)))
    with pytest.raises(InputError, match="the target has only 16 x 4"):
        model.synthesize(other_maps((4, 16)), uniform_times(6))
    small = sequence(stacked(cubics(uniform_times(6)))[:, :, :3], uniform_times(6))
    with pytest.raises(InputError, match="the source has only 3 x 12"):
        stt.fit(small)
