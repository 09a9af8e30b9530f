"""Grain: more of the like of an example, without a seam and without visible repetition."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from model_runtime.surface.laying import lay_grain
from model_runtime.temporal.grain import Grain
from tests import grained_model, meshes
from tests.meshes import atlas_of

SIZE = (1024, 1024)


@pytest.fixture(scope="module")
def grain() -> Grain:
    return grained_model.grain(8, side=512)


@pytest.fixture(scope="module")
def tile(grain: Grain) -> NDArray[np.float32]:
    """[1024, 1024, 3]"""
    return laid(grain, SIZE, 1)


def laid(grain: Grain, size: tuple[int, int], seed: int) -> NDArray[np.float32]:
    return grain.in_tile(size, seed).reshape(*size, 3).astype(np.float32)


def example(grain: Grain) -> NDArray[np.float32]:
    """[S, S, 3]: the values of the tile itself."""
    values = [table[levels] for table, levels in zip(grain.table, grain.tile, strict=True)]
    return np.stack(values, -1)


def alike(one: NDArray[Any], other: NDArray[Any]) -> float:
    """Correlation of two arrays [..., C], the mean over components."""
    pairs = zip(np.moveaxis(one, -1, 0), np.moveaxis(other, -1, 0), strict=True)
    return float(np.mean([np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in pairs]))


def sphere(count: int, radius: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    normal = np.random.default_rng(0).standard_normal((count, 3)).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return normal * np.float32(radius), normal


def has_the_statistics_of(values: NDArray[np.float32], truth: NDArray[np.float32]) -> None:
    flat, true = values.reshape(-1, 3), truth.reshape(-1, 3)
    assert np.abs(flat.mean(0) - true.mean(0)).max() < 0.08
    assert np.abs(flat.std(0) - true.std(0)).max() < 0.08
    for share in (0.05, 0.5, 0.95):
        assert np.abs(np.quantile(flat, share, 0) - np.quantile(true, share, 0)).max() < 0.15


def test_a_tile_has_the_example_s_histogram(grain: Grain, tile: NDArray[np.float32]):
    assert tile.shape == (*SIZE, 3)
    has_the_statistics_of(tile, example(grain))


def test_and_its_neighborhoods(grain: Grain, tile: NDArray[np.float32]):
    truth = example(grain)
    for step in (1, 3, 8):
        for axis in (0, 1):
            own = alike(tile, np.roll(tile, step, axis))
            assert own == pytest.approx(alike(truth, np.roll(truth, step, axis)), abs=0.06)


def test_it_wraps(tile: NDArray[np.float32]):
    for axis in (0, 1):
        step = np.abs(np.diff(tile, axis=axis)).mean()
        edge = np.abs(tile.take(0, axis) - tile.take(-1, axis)).mean()
        assert edge < 1.25 * step


@pytest.mark.parametrize("size", [(300, 777), (777, 300), (64, 640), (1, 1), (3, 200)])
def test_so_do_tiles_of_any_shape(grain: Grain, size: tuple[int, int]):
    found = laid(grain, size, 3)
    assert np.isfinite(found).all()
    for axis in (0, 1):
        if size[axis] > 100:
            step = np.abs(np.diff(found, axis=axis)).mean()
            assert np.abs(found.take(0, axis) - found.take(-1, axis)).mean() < 1.4 * step


@pytest.mark.parametrize("count", [1, 2, 5, 6])
def test_a_component_is_the_same_whatever_is_beside_it(
    grain: Grain, tile: NDArray[np.float32], count: int
):
    some = np.arange(count) % 3
    other = Grain(grain.tile[some], grain.table[some], grain.shapes[:, some], grain.share)
    assert np.array_equal(other.in_tile(SIZE, 1), tile.reshape(-1, 3)[:, some])
    places = sphere(4000, 0.3)
    found, known = (each.on_surface(*places, 0.5, 1) for each in (other, grain))
    assert np.array_equal(found, known[:, some])


def test_nothing_repeats(grain: Grain, tile: NDArray[np.float32]):
    period = 512  # texels of the example's tile
    shifts = [(0, period), (period, 0), (period, period), (0, 300), (211, 400)]
    for shift in shifts:
        assert abs(alike(tile, np.roll(tile, shift, (0, 1)))) < 0.08


def test_the_seed_is_all_that_differs(grain: Grain, tile: NDArray[np.float32]):
    assert np.array_equal(tile, laid(grain, SIZE, 1))
    assert abs(alike(tile, laid(grain, SIZE, 2))) < 0.08
    assert np.isfinite(laid(grain, (32, 32), 2**63 - 1)).all()


@pytest.mark.parametrize("times", [2, 4, 8])
def test_a_small_one_is_the_large_one_from_afar(
    grain: Grain, tile: NDArray[np.float32], times: int
):
    side = SIZE[0] // times
    afar = tile.reshape(side, times, side, times, 3).mean((1, 3))
    small = laid(grain, (side, side), 1)
    coarse = slice(0, 3 if times < 8 else 2)  # the waves of the last are no longer than texels
    assert alike(afar[..., coarse], small[..., coarse]) > 0.9
    assert np.abs(small.std((0, 1)) - afar.std((0, 1))).max() < 0.15
    assert np.abs(small.mean((0, 1)) - afar.mean((0, 1))).max() < 0.05


def test_and_a_larger_one_is_it_from_near(grain: Grain, tile: NDArray[np.float32]):
    near = laid(grain, (2048, 2048), 1)
    assert alike(near.reshape(1024, 2, 1024, 2, 3).mean((1, 3)), tile) > 0.9
    assert np.abs(near.std((0, 1)) - tile.std((0, 1))).max() < 0.05
    # It is the example made larger, and not its texels made larger.
    step = [np.abs(np.diff(near[:, first::2][:, :1000], axis=1)).mean() for first in (0, 1)]
    assert step[0] == pytest.approx(step[1], rel=0.05)
    assert np.abs(np.diff(near, axis=1)[:, ::2]).mean() > 0.2 * np.abs(np.diff(tile, axis=1)).mean()


def test_a_surface_has_the_example_s_histogram(grain: Grain):
    position, normal = sphere(1 << 18, 4.0)
    found = grain.on_surface(position, normal, 1.0, 1).astype(np.float32)
    has_the_statistics_of(found, example(grain))


def test_on_a_plane_it_is_as_in_a_tile(grain: Grain):
    side, away = 1.4, 1.4 / 512
    x, y = np.meshgrid(*(np.arange(512, dtype=np.float32) * np.float32(away),) * 2)
    for axis in range(3):
        flat = [x.ravel(), y.ravel()]
        flat.insert(axis, np.full(x.size, 7.3, np.float32))
        normal = np.zeros((x.size, 3), np.float32)
        normal[:, axis] = -1
        found = grain.on_surface(np.stack(flat, -1), normal, side, 1).reshape(512, 512, 3)
        for step in (1, 5):
            truth = example(grain)
            for along in (0, 1):
                expected = alike(truth, np.roll(truth, step, along))
                kept = found.astype(np.float32)
                own = alike(
                    np.delete(kept, np.s_[:step], along), np.delete(kept, np.s_[-step:], along)
                )
                assert own == pytest.approx(expected, abs=0.08)


def test_on_a_surface_it_is_a_function_of_the_place(grain: Grain):
    position, normal = sphere(5000, 2.0)
    whole = grain.on_surface(position, normal, 1.0, 1)
    chosen = np.random.default_rng(1).permutation(5000)[:300]
    assert np.array_equal(grain.on_surface(position[chosen], normal[chosen], 1.0, 1), whole[chosen])
    near = grain.on_surface(position + np.float32(1e-4), normal, 1.0, 1)
    assert alike(near.astype(np.float32), whole.astype(np.float32)) > 0.95
    assert abs(alike(grain.on_surface(position, normal, 1.0, 2), whole)) < 0.1


def test_on_a_surface_far_from_the_origin_and_without_a_normal(grain: Grain):
    position, _ = sphere(1000, 2.0)
    found = grain.on_surface(position - 300, np.zeros_like(position), 0.5, 1)
    assert np.isfinite(found).all()


def test_on_a_surface_a_coarse_texture_shows_it_from_afar(grain: Grain):
    position, normal = sphere(1 << 16, 4.0)
    near = grain.on_surface(position, normal, 1.0, 1).astype(np.float32)
    afar = grain.on_surface(position, normal, 1.0, 1, texel=8 / 512).astype(np.float32)
    assert (afar.std(0) < near.std(0) + 0.05).all()
    assert afar[:, 2].std() < 0.5  # its waves are hardly longer than such a texel
    assert alike(afar, near) > 0.3
    assert np.abs(afar.mean(0) - near.mean(0)).max() < 0.1


def test_how_long_it_takes(grain: Grain, record_property: Any):
    start = time.perf_counter()
    grain.in_tile(SIZE, 5)
    record_property("tile_seconds", round(time.perf_counter() - start, 3))
    position, normal = sphere(1 << 20, 2.0)
    start = time.perf_counter()
    grain.on_surface(position, normal, 1.4, 1)
    record_property("surface_seconds", round(time.perf_counter() - start, 3))


def test_grain_that_was_laid_before_is_never_another_s(grain: Grain):
    ball = atlas_of(meshes.ball((0, 0, 0), 0.5), 64)
    first = lay_grain(grain, ball, (64, 64), side=1.0, seed=1)
    before = first.copy()
    first *= 0  # what was handed out is its owner's
    others = (
        lay_grain(grain, ball, (64, 64), side=1.0, seed=2),
        lay_grain(grain, ball, (64, 64), side=0.5, seed=1),
        lay_grain(grained_model.grain(8, side=256), ball, (64, 64), side=1.0, seed=1),
        lay_grain(grain, atlas_of(meshes.ball((0, 0, 0), 0.7), 64), (64, 64), side=1.0, seed=1),
    )
    assert len({before.tobytes(), *(each.tobytes() for each in others)}) == 5
    again = grained_model.grain(8, side=512)  # read anew
    np.testing.assert_array_equal(lay_grain(again, ball, (64, 64), side=1.0, seed=1), before)
