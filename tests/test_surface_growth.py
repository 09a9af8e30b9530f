"""Growth over a surface: no seams, what is exposed first, the same at every size."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from model_runtime.surface.atlas import Atlas
from model_runtime.surface.exposure import Exposure
from model_runtime.surface.graph import join
from model_runtime.surface.points import sample
from model_runtime.surface.seams import Seen
from model_runtime.surface.timing import surface_timing
from model_runtime.temporal.onset import onset_map
from model_runtime.temporal.pace import Timing
from tests.meshes import atlas_of, ball, box, pipe, quad, rank_correlation, turned_inside_out

PROCESSES = ("rust", "patina", "char", "drying", "fading", "soiling", "yellowing", "moss")
BLOCK = box((0, 0, 0.5), (1, 1, 1))
MESHES = {
    "block": BLOCK,
    "ball": ball((0, 0, 0), 0.5),
    "pipe": pipe((0, 0, 1), 0.2, 2.0),
    "ball on a block": [*BLOCK, *ball((0, 0, 1.39), 0.4)],
}


@pytest.fixture(scope="module")
def block() -> Atlas:
    return atlas_of(BLOCK, 256)


def onset_of(atlas: Atlas, process: str = "rust", size: int = 256, **settings):
    settings = {"seed": 3, "exposure": Exposure.of(process)} | settings
    return surface_timing(atlas, process, (size, size), **settings)


@pytest.mark.parametrize("process", PROCESSES)
@pytest.mark.parametrize("mesh", MESHES)
def test_nothing_shows_where_the_seams_are(mesh, process):
    found = onset_of(atlas_of(MESHES[mesh], 256), process)
    assert found.seam_ratio is not None
    assert found.seam_ratio <= 1.3


def test_nor_do_they_where_the_map_is_finer_than_what_was_baked(block):
    ratio = onset_of(block, size=1024).seam_ratio
    assert ratio is not None and ratio <= 1.3


def test_a_pattern_of_the_texture_shows_where_the_seams_are(block):
    ratio = Seen.of(block, onset_map("rust", (256, 256), seed=3)).seam_ratio()
    assert ratio is not None
    assert ratio > 5


@pytest.mark.parametrize("name", ["edges", "sky", "ground"])
@pytest.mark.parametrize("weight", [1.0, -1.0])
def test_what_is_exposed_starts_first(block, name, weight):
    alone = dict.fromkeys(Exposure().json(), 0.0) | {"pattern": 0.3, name: weight}
    onset = onset_of(block, exposure=Exposure(**alone)).onset
    feature = -block.position[..., 2] if name == "ground" else block.features[name]
    correlation = rank_correlation(feature[block.covered], onset[block.covered])
    assert -np.sign(weight) * correlation >= 0.6


def test_what_a_place_is_like_does_not_depend_on_the_size_of_the_texture():
    atlas = atlas_of(BLOCK, 512)
    fine, coarse = (onset_of(atlas, size=size).onset for size in (512, 128))
    inside = atlas.covered.reshape(128, 4, 128, 4).all((1, 3))
    assert np.abs(coarse - fine.reshape(128, 4, 128, 4).mean((1, 3)))[inside].mean() < 0.05
    larger = atlas_of(BLOCK, 1024)
    both = np.kron(atlas.covered, np.ones((2, 2), bool)) & larger.covered
    difference = onset_of(larger, size=1024).onset - onset_of(atlas, size=1024).onset
    assert np.abs(difference)[both].mean() < 0.02


def test_the_same_arguments_give_the_same_maps_and_another_seed_others(block):
    first, again, other = (onset_of(block, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.onset, again.onset)
    np.testing.assert_array_equal(first.rate, again.rate)
    assert np.abs(first.onset - other.onset).mean() > 0.02


def test_every_seed_keeps_the_pace(block):
    curves = [list(onset_of(block, seed=seed).account["started"].values()) for seed in (1, 2, 3)]
    assert np.ptp(curves, axis=0).max() < 0.02


def test_the_pace_is_that_of_the_source_where_it_is_known(block):
    timing = Timing.of(np.linspace(0.2, 0.4, 100), np.linspace(0.5, 0.7, 100))
    found = onset_of(
        block, timing=timing, exposure=Exposure(edges=0.6)
    )  # runs have a pace of their own
    assert 0.2 <= found.onset.min() < 0.21 and 0.39 < found.onset.max() <= 0.4
    assert 0.5 <= found.rate.min() < 0.51 and 0.69 < found.rate.max() <= 0.7


def test_only_an_amount_of_the_surface_starts(block):
    onset = onset_of(block, amount=0.4).onset[block.covered]
    assert np.mean(onset < 1) == pytest.approx(0.4, abs=0.02)
    assert onset[onset < 1].max() > 0.8
    assert (onset_of(block, amount=0.0).onset == 1).all()


def test_it_spreads_from_where_it_began(block):
    """Half way, nearly all that has turned hangs together with what turned first."""
    onset, covered = onset_of(block, exposure=Exposure.of("rust")).onset, block.covered
    turned = covered & (onset <= np.median(onset[covered]))
    labels, _ = ndimage.label(turned)
    began = np.unique(labels[covered & (onset <= np.quantile(onset[covered], 0.06))])
    assert np.isin(labels[turned], began[began > 0]).mean() > 0.9


def test_what_no_face_covers_has_what_is_next_to_it():
    atlas = atlas_of(BLOCK, 128, margin=0.05)
    onset = onset_of(atlas, size=128).onset
    assert onset[~atlas.covered].min() >= onset[atlas.covered].min()
    gap = ~atlas.covered
    nearest = ndimage.distance_transform_edt(gap, return_distances=False, return_indices=True)
    assert np.mean(onset[gap] == onset[tuple(nearest)][gap]) > 0.8  # by another distance


def test_two_sides_of_a_sheet_are_two_places():
    thin = 0.002
    front = quad((0, 0, 1), (0, 0, -1), (1, 0, 0))
    back = turned_inside_out(quad((0, thin, 1), (0, 0, -1), (1, 0, 0)))
    points = sample(atlas_of([front, back], 256))
    graph = join(points)
    assert points.spacing > 2 * thin
    known = np.isfinite(graph.distance)
    across = (points.normal[graph.neighbor] * points.normal).sum(-1) < 0
    middle = (np.abs(points.position[:, [0, 2]] - 0.5) < 0.5 - 2 * points.spacing).all(-1)
    assert not (across & known)[:, middle].any()  # at the rim they meet


def test_faces_turned_inside_out_are_still_next_to_their_neighbors():
    left = quad((0, 0, 1), (0, 0, -1), (1, 0, 0))
    right = turned_inside_out(quad((1, 0, 1), (0, 0, -1), (1, 0, 0)))
    points = sample(atlas_of([left, right], 256))
    graph = join(points)
    across = (points.normal[graph.neighbor] * points.normal).sum(-1) < 0
    assert np.isfinite(graph.distance[across]).sum() > 100


def test_what_touches_is_joined_and_what_does_not_is_not():
    def reached(gap: float) -> bool:
        atlas = atlas_of([*BLOCK, *box((0, 0, 1.5 + gap), (1, 1, 1))], 256)
        points = sample(atlas)
        graph = join(points)
        upper = points.position[:, 2] > 1 + gap / 2
        return bool((np.isfinite(graph.distance) & (upper[graph.neighbor] != upper)).any())

    assert reached(0.0)
    assert not reached(0.1)


def test_islands_of_a_few_texels_and_texels_heaped_on_one_place_are_no_trouble():
    screws = [patch for x in range(5) for patch in ball((x, 0, 1), 0.01)]
    found = onset_of(atlas_of([*BLOCK, *screws], 128, margin=0.03), size=128)
    assert np.isfinite(found.onset).all()
    heap = np.zeros((64, 64, 3), np.float32)
    normal = np.broadcast_to(np.float32((0, 0, 1)), heap.shape)
    atlas = Atlas(heap, normal, np.ones((64, 64), bool), (0.0, 0.0, 0.0))
    assert np.isfinite(onset_of(atlas, size=64).onset).all()


def test_what_is_masked_white_never_starts_and_what_is_gray_starts_late(block):
    mask = np.zeros(block.covered.shape, np.float32)
    mask[:80], mask[80:128] = 1, 0.5
    masked = replace(block, features=block.features | {"blocked": mask})
    onset = onset_of(masked).onset
    assert (onset[block.covered & (mask == 1)] == 1).all()
    free, gray = (onset[block.covered & (mask == level)] for level in (0, 0.5))
    assert free.max() < 1
    assert gray.mean() > free.mean() + 0.2


@pytest.mark.parametrize("pattern", [0.0, 1.0])
def test_where_it_is_told_to_start_it_starts_and_spreads(block, pattern):
    """Near a corner on top, in meters of the world."""
    place = np.array((0.3, 0.3, 1.0))
    exposure = Exposure(pattern=pattern)
    far = replace(block, origin=(8.0, 0.0, 0.0))
    starts = [tuple((place + far.origin).tolist())]
    onset = onset_of(far, exposure=exposure, starts=starts).onset[block.covered]
    away = np.linalg.norm(block.position[block.covered] - place, axis=-1)
    assert onset[away < 0.03].max() < np.quantile(onset, 0.05)
    assert onset[away < 0.1].mean() < 0.6 * onset.mean()


def test_what_is_kept_of_the_last_growth_is_never_another_s(block):
    first = onset_of(block)
    before = first.onset.copy()
    first.onset[:] = 0  # what was handed out is its owner's
    worn = np.zeros(block.size, np.float32)
    worn[:64] = 1
    others = (
        onset_of(block, seed=4),
        onset_of(block, "moss"),
        onset_of(block, exposure=Exposure.of("rust").changed({"sky": -1})),
        onset_of(block, marks={"wear": worn}),
        onset_of(block, marks={"wear": 1 - worn}),
        onset_of(block, starts=[(0, 0, 0)]),
        onset_of(replace(block, origin=(1, 0, 0)), starts=[(0, 0, 0)]),
        onset_of(block, pattern_size=0.2),
        onset_of(block, amount=0.5),
    )
    maps = [before, *(other.onset for other in others)]
    assert len({each.tobytes() for each in maps}) == len(maps)
    assert onset_of(block, size=128).onset.shape == (128, 128)
    np.testing.assert_array_equal(onset_of(block).onset, before)


def test_the_size_that_is_told_of_a_learned_pattern_draws_it_again():
    small = atlas_of(BLOCK, 128)
    learned = Timing.of(np.linspace(0, 0.8), scale=0.035)
    told = onset_of(small, size=128, timing=learned)
    again = onset_of(small, size=128, timing=learned, pattern_size=told.account["pattern_size"])
    onsets = (each.onset[small.covered] for each in (told, again))
    assert rank_correlation(*onsets) > 0.99


def test_the_same_again_takes_no_time(block):
    first = onset_of(block)
    started = time.process_time()
    again = onset_of(block)
    assert time.process_time() - started < 0.05
    np.testing.assert_array_equal(first.onset, again.onset)
    np.testing.assert_array_equal(first.rate, again.rate)
