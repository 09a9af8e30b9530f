"""A pattern that was learned: as large, as long and as ragged as its source's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from model_runtime.surface.exposure import Exposure
from model_runtime.surface.timing import surface_timing
from model_runtime.temporal.onset import onset_map
from model_runtime.temporal.pace import Timing
from model_runtime.temporal.waves import Wave, octaves, stretch_of, waves_from_json
from tests.meshes import atlas_of, quad, rank_correlation
from training.source.onsets import correlation_length
from training.source.pattern import waves_of

SIDE = 256
SHARE = 0.3
PROCESSES = ("rust", "peeling_wood", "moss", "frost")


def source(down: float, across: float, *, crumbs: float = 0.0, seed: int = 0) -> np.ndarray:
    """Three tenths of a tile that wraps: where smooth noise with such regions, in texels, and so
    many crumbs is high.
    """
    rng = np.random.default_rng(seed)
    field, fine = (
        ndimage.gaussian_filter(rng.standard_normal((SIDE, SIDE)), size, mode="wrap")
        for size in ((down, across), (1, 1))
    )
    field = field / field.std() + crumbs * fine / fine.std()
    return field > np.quantile(field, 1 - SHARE)


def learned(weathered: np.ndarray, process: str) -> Timing:
    scale = correlation_length(weathered.astype(np.float32))
    assert scale is not None
    waves = waves_of(weathered, scale=scale, process=process)
    return Timing.of(np.linspace(0, 1, 99), scale=scale, waves=waves)


def begun(timing: Timing, process: str, seed: int = 1) -> np.ndarray:
    return onset_map(process, (SIDE, SIDE), seed=seed, timing=timing) < SHARE


def border(weathered: np.ndarray) -> tuple[float, float]:
    """How often it changes from one texel to the next, down and across."""
    down, across = (
        float(np.abs(np.diff(weathered.astype(int), axis=axis)).mean()) for axis in (0, 1)
    )
    return down, across


@pytest.mark.parametrize("process", PROCESSES)
@pytest.mark.parametrize(("down", "across"), [(12, 3), (3, 12), (6, 6)])
def test_what_grows_is_as_long_and_as_wide(process: str, down: float, across: float):
    given = source(down, across)
    for found, told in zip(
        border(begun(learned(given, process), process)), border(given), strict=True
    ):
        assert found == pytest.approx(told, rel=0.35)


@pytest.mark.parametrize("crumbs", [0.0, 0.1, 0.3])
def test_its_borders_are_as_ragged(crumbs: float):
    given = source(10, 10, crumbs=crumbs)
    found = begun(learned(given, "rust"), "rust")
    assert sum(border(found)) == pytest.approx(sum(border(given)), rel=0.3)


def test_a_ragged_border_is_not_for_more_regions():
    """Two maps of as much border: one of few ragged regions, one of many smooth ones."""
    ragged = source(14, 14, crumbs=0.1)
    smooth = next(
        each for size in np.arange(14, 2, -0.25)
        if sum(border(each := source(size, size))) >= sum(border(ragged))
    )  # fmt: skip
    sizes = [correlation_length(begun(learned(each, "rust"), "rust")) for each in (ragged, smooth)]
    assert sizes[0] is not None and sizes[1] is not None
    assert sizes[0] > 1.25 * sizes[1]


def test_a_map_of_one_kind_or_too_small_has_none():
    for given in (np.zeros((SIDE, SIDE), bool), np.ones((SIDE, SIDE), bool), source(9, 9)[:20]):
        assert waves_of(given, scale=0.1, process="rust") == ()


def test_a_small_map_is_the_large_one_from_further_away():
    timing = learned(source(12, 3), "rust")
    large, small = (onset_map("rust", (side, side), seed=1, timing=timing) for side in (512, 128))
    coarse = large.reshape(128, 4, 128, 4).mean((1, 3))
    assert rank_correlation(coarse.ravel(), small.ravel()) > 0.95


def test_streaks_hang_down_on_a_wall():
    timing = learned(source(12, 3), "rust")
    wall = atlas_of([quad((-1, 0, 1), (0, 0, -2), (2, 0, 0))], 256)
    weights = dict.fromkeys(Exposure().json(), 0.0) | {"pattern": 1.0}
    grown = surface_timing(
        wall, "rust", (SIDE, SIDE), seed=1, exposure=Exposure(**weights), timing=timing
    )
    covered = np.flatnonzero(wall.covered.any(1)), np.flatnonzero(wall.covered.any(0))
    onset = grown.onset[np.ix_(*covered)]
    # of the wall's own axes: its rows go down
    along, across = (np.abs(np.diff(onset, axis=axis)).mean() for axis in (0, 1))
    if np.ptp(wall.position[covered[0][0], covered[1], 2]) > 1:
        along, across = across, along
    assert across > 1.7 * along


def test_what_is_exposed_still_starts_first():
    timing = learned(source(6, 6, crumbs=0.1), "rust")
    slope = atlas_of([quad((-1, 0, 1), (0, 0, -2), (2, 0, 0))], 256)
    weights = dict.fromkeys(Exposure().json(), 0.0) | {"pattern": 0.5, "ground": 1.0}
    onset = surface_timing(
        slope, "rust", (SIDE, SIDE), seed=1, exposure=Exposure(**weights), timing=timing
    ).onset
    height = slope.position[..., 2][slope.covered]
    assert rank_correlation(height, onset[slope.covered]) > 0.5


def test_waves_come_back_from_a_card():
    timing = learned(source(12, 3), "rust")
    assert timing.waves
    assert Timing.from_json(timing.json()) == timing
    assert "waves" not in Timing.of(0.5).json()


@pytest.mark.parametrize(
    "waves", [None, {}, [[1, 2]], [[1, 0, 1]], [[1, 1, -1]], [[1, 1, "a"]], [[1, 1, 1]] * 33]
)
def test_no_other_waves_are_taken(waves):
    with pytest.raises(ValueError, match=r"wave"):
        waves_from_json(waves)


def test_hostile_waves_take_no_more_memory_than_others():
    timing = Timing.of(np.linspace(0, 1, 9), scale=0.01, waves=(Wave(1e5, 1e5, 1.0),))
    assert onset_map("rust", (64, 64), seed=0, timing=timing).shape == (64, 64)


def test_octaves_are_of_one_shape():
    first, second = [wave for wave, _ in zip(octaves((2, 8), 0.5), range(2), strict=False)]
    assert first == Wave(2, 8, 1.0) and second == Wave(4, 16, 0.5)
    assert stretch_of((first, second)) == pytest.approx(4)
