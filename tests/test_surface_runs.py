"""Water stains what lies below, not beside, what it comes from."""

from __future__ import annotations

import numpy as np
import pytest

from model_runtime.surface.atlas import Atlas
from model_runtime.surface.exposure import Exposure
from model_runtime.surface.graph import join
from model_runtime.surface.points import Points, sample
from model_runtime.surface.runs import deposit
from model_runtime.surface.timing import SurfaceTiming, surface_timing
from tests.meshes import BOLTED, BOLTS, atlas_of, below_and_beside, bolted_wall, quad


@pytest.fixture(scope="module")
def wall() -> tuple[Points, np.ndarray]:
    """The points of a wall with two bolts, and how much has settled on each."""
    points = sample(atlas_of(BOLTED, 512))
    arrival = np.ones(len(points), np.float32)
    for x in BOLTS:
        arrival[np.linalg.norm(points.position - (x, 0, 0.8), axis=-1) < 0.035] = 0
    sky = np.maximum(points.normal[:, 2], 0)
    rng = np.random.default_rng(0)
    settled = deposit(points, join(points), arrival, sky=sky, unit=1.0, rng=rng).settled
    return points, settled


def test_what_weathers_stains_below_and_not_beside(wall):
    points, settled = wall
    x, y, z = points.position.T
    away = np.min([np.abs(x - each) for each in BOLTS], 0)
    low = (np.abs(y) < 0.01) & (z > 0.55) & (z < 0.75)
    below, beside = settled[low & (away < 0.03)].mean(), settled[low & (away > 0.1)].mean()
    assert below > 0.2
    assert below > 10 * beside
    assert settled[(z > 0.85) & (np.abs(y) < 0.01)].max() < 0.05  # water does not climb


def test_a_stain_grows_thinner_on_its_way_down(wall):
    points, settled = wall
    x, y, z = points.position.T
    near = (np.abs(y) < 0.01) & (np.min([np.abs(x - each) for each in BOLTS], 0) < 0.1)
    upper, lower = (settled[near & (np.abs(z - each) < 0.05)].sum() for each in (0.65, 0.15))
    assert upper > 1.5 * lower


@pytest.fixture(scope="module")
def concrete() -> Atlas:
    return bolted_wall(256)


def timing_of(atlas: Atlas, runs: float, **settings) -> SurfaceTiming:
    exposure = Exposure(runs=runs, pattern=0.5)
    return surface_timing(atlas, "rust", (256, 256), seed=0, exposure=exposure, **settings)


def test_what_is_below_starts_earlier_where_runs_count_and_later_where_they_wash(concrete):
    below, _ = below_and_beside(concrete)
    sought, none, avoided = (timing_of(concrete, runs).onset[below] for runs in (0.8, 0, -0.8))
    assert sought.mean() < 0.8 * none.mean()
    assert avoided.mean() > none.mean() + 0.02


def test_a_stain_is_what_is_young(concrete):
    """It shows below the bolts and nearly nowhere beside them, and never is as old as they are."""
    below, beside = below_and_beside(concrete)
    young = 0.15
    found = timing_of(concrete, 1.0, amount=0.08, stains=(0.0, young))
    age = found.rate * (1 - found.onset)
    assert age[below].mean() > 20 * age[beside].mean()
    assert 0.25 * young < age[below].mean() < 1.1 * young
    bolts = concrete.covered & (concrete.position[..., 1] < -0.02)
    assert age[bolts].mean() > 3 * young


def test_what_a_place_would_come_to_without_runs_it_comes_to_with_them(concrete):
    without, stained = (timing_of(concrete, runs) for runs in (0.0, 0.8))
    age, other = (each.rate * (1 - each.onset) for each in (stained, without))
    assert (age >= other - 0.1)[concrete.covered].mean() > 0.95


def test_where_nothing_runs_nothing_is_stained():
    flat = atlas_of([quad((0, 0, 0), (0, 1, 0), (1, 0, 0))], 128)
    found, without = (timing_of(flat, runs) for runs in (0.8, 0.0))
    np.testing.assert_allclose(found.rate, without.rate, rtol=1e-6)
