"""How many pixels fall on a texture, against cases worked out by hand and by brute force."""

from __future__ import annotations

import numpy as np
import pytest

from tvbrdf.tvbrdf_addon.material.reading.density import pixels_across

# A camera at the origin that looks along -z, 90 degrees wide, clipped at 0.1 and 100.
NEAR, FAR = 0.1, 100.0
CLIP = np.array(
    (
        (1, 0, 0, 0),
        (0, 1, 0, 0),
        (0, 0, -(FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR)),
        (0, 0, -1, 0),
    )
)
FOCAL = 500.0
UNIT = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), float)


def quad(*corners: tuple[float, float, float], uv: np.ndarray = UNIT):
    """Two triangles of a quadrangle with the whole texture on it."""
    order = [(0, 1, 2), (0, 2, 3)]
    return np.array(corners, float)[order], uv[order]


def seen(corners: np.ndarray, uv: np.ndarray) -> float:
    return pixels_across(corners, uv, CLIP, FOCAL)


def wall(distance: float, side: float = 1.0, x: float = 0.0, **options):
    half = side / 2
    around = ((-half, -half), (half, -half), (half, half), (-half, half))
    return quad(*((x + a, b, -distance) for a, b in around), **options)


def test_a_wall_is_as_large_as_it_looks():
    assert seen(*wall(2.0)) == pytest.approx(250)
    assert seen(*wall(8.0)) == pytest.approx(62.5)


def test_a_texture_that_repeats_needs_fewer_texels():
    assert seen(*wall(2.0, uv=5 * UNIT)) == pytest.approx(50)


def test_the_longer_stretch_counts():
    squeezed = UNIT * (1.0, 0.25)  # a unit of v spans four times the world
    assert seen(*wall(2.0, uv=squeezed)) == pytest.approx(1000)


@pytest.mark.parametrize("where", [(0, 0, 3), (50, 0, -2), (0, 0, -0.05)])
def test_what_is_behind_beside_or_too_near_is_not_seen(where):
    corners, uv = wall(0.0, side=0.01)
    assert seen(corners + np.array(where), uv) == 0


def test_the_ground_counts_from_where_the_picture_begins():
    """A plane 1 below the camera enters the picture, 45 degrees down, at a distance of 1."""
    ground = quad((-90, -1, 90), (90, -1, 90), (90, -1, -90), (-90, -1, -90))
    assert seen(*ground) == pytest.approx(FOCAL * 180 / 1.0)


def test_a_wall_larger_than_the_picture():
    assert seen(*wall(2.0, side=500.0)) == pytest.approx(FOCAL * 500 / 2)


def test_clipping_agrees_with_cutting_into_small_pieces():
    rng = np.random.default_rng(0)
    compared = 0
    while compared < 12:
        corners = rng.uniform((-3, -3, -4), (3, 3, 1), (1, 3, 3))
        uv = rng.uniform(0, 1, (1, 3, 2))
        pieces = corners
        for _ in range(7):
            pieces = halved(pieces)
        if (expected := nearest(pieces)) is None:
            continue
        assert depth_at(seen(corners, uv), corners, uv) == pytest.approx(expected, abs=0.1)
        compared += 1


def halved(corners: np.ndarray) -> np.ndarray:
    """Each triangle cut into four."""
    a, b, c = (corners[:, i] for i in range(3))
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    four = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([np.stack(each, 1) for each in four])


def nearest(pieces: np.ndarray) -> float | None:
    """The least depth among the pieces whose centers lie in the picture."""
    centers = pieces.mean(1)
    depth = -centers[:, 2]
    within = (depth > NEAR) & (np.abs(centers[:, :2]).max(1) <= depth)
    return depth[within].min(initial=np.inf) if within.any() else None


def depth_at(pixels: float, corners: np.ndarray, uv: np.ndarray) -> float:
    """The depth at which a triangle gets so many pixels."""
    world, texture = (np.diff(each[0], axis=0).T for each in (corners, uv))
    stretch = np.linalg.svd(world @ np.linalg.inv(texture), compute_uv=False)[0]
    return FOCAL * stretch / pixels


def test_slivers_do_not_decide():
    good = wall(2.0)
    sliver = quad((0, 0, -2), (1e-3, 0, -2), (1e-3, 1e-3, -2), (0, 1e-3, -2), uv=UNIT * 1e-6)
    both = tuple(np.concatenate(each) for each in zip(good, sliver, strict=True))
    assert seen(*both) == pytest.approx(250)


def test_faces_without_a_place_in_the_texture_are_left_out():
    flat = wall(1.0, uv=np.zeros((4, 2)))
    assert seen(*flat) == 0
    both = tuple(np.concatenate(each) for each in zip(flat, wall(2.0), strict=True))
    assert seen(*both) == pytest.approx(250)
