"""Water stains what lies below, not beside, what it comes from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from model_runtime.surface.exposure import Exposure
from model_runtime.surface.graph import join
from model_runtime.surface.points import Points, sample
from model_runtime.surface.runs import deposit
from model_runtime.surface.timing import surface_timing
from tests.meshes import atlas_of, ball, quad

BOLTS = (0.3, 0.7)
WALL = [
    quad((0, 0, 1), (0, 0, -1), (1, 0, 0)),
    *(patch for x in BOLTS for patch in ball((x, 0, 0.8), 0.03)),
]


@pytest.fixture(scope="module")
def wall() -> tuple[Points, np.ndarray]:
    """The points of a wall with two bolts, and how much has settled on each."""
    points = sample(atlas_of(WALL, 512))
    iron = np.zeros(len(points), np.float32)
    for x in BOLTS:
        iron[np.linalg.norm(points.position - (x, 0, 0.8), axis=-1) < 0.035] = 1
    sky = np.maximum(points.normal[:, 2], 0)
    rng = np.random.default_rng(0)
    settled = deposit(points, join(points), susceptibility=iron, sky=sky, unit=1.0, rng=rng)
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


def test_what_is_below_starts_earlier_where_runs_count():
    atlas = atlas_of(WALL, 256)
    x, y, z = np.moveaxis(atlas.position, -1, 0) + np.reshape(atlas.origin, (3, 1, 1))
    flat = atlas.covered & (np.abs(y) < 0.01)
    under = flat & (np.min([np.abs(x - each) for each in BOLTS], 0) < 0.03)
    under &= (z < 0.75) & (z > 0.5)
    late = {"blocked": np.where(flat, 0.5, 0).astype(np.float32)}  # the bolts are iron
    atlas = replace(atlas, features=atlas.features | late)

    def onset_there(runs: float) -> float:
        exposure = Exposure(runs=runs, pattern=0.5)
        found = surface_timing(atlas, "rust", (256, 256), seed=0, exposure=exposure)
        return float(found.onset[under].mean())

    assert onset_there(0.8) < 0.8 * onset_there(0.0)
