"""Texels of triangles, shells and charts: what needs no Blender of the surface's maps."""

from __future__ import annotations

import numpy as np
import pytest

from tvbrdf.tvbrdf_addon.material.surface_maps.charts import Faces, laid_out
from tvbrdf.tvbrdf_addon.material.surface_maps.raster import rasterize
from tvbrdf.tvbrdf_addon.material.surface_maps.shells import components, turned_in

SQUARE = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], np.float32)


def texels_of(points: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The number of the texel in which each place of the square lies."""
    column = (points[:, 0] * size[1]).astype(int).clip(0, size[1] - 1)
    row = ((1 - points[:, 1]) * size[0]).astype(int).clip(0, size[0] - 1)
    return row * size[1] + column


def points_in(triangles: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """So many random places in each triangle [T, 3, C]: [T * count, C]."""
    weights = rng.dirichlet((1, 1, 1), (len(triangles), count))
    return np.einsum("tnk,tkc->tnc", weights, triangles).reshape(-1, triangles.shape[2])


def test_a_texel_shows_what_lies_at_its_center():
    raster = rasterize(SQUARE, (6, 8))
    shown = raster.image(raster.values(SQUARE))
    rows, columns = np.mgrid[0:6, 0:8]
    np.testing.assert_allclose(shown[..., 0], (columns + 0.5) / 8, atol=1e-6)
    np.testing.assert_allclose(shown[..., 1], 1 - (rows + 0.5) / 6, atol=1e-6)
    assert raster.centers.all()
    assert not raster.shared.any()


@pytest.mark.parametrize("span", [0.001, 0.03, 0.5])
def test_no_texel_that_a_triangle_reaches_into_is_left_out(span):
    rng = np.random.default_rng(1)
    size = (40, 60)
    triangles = rng.random((60, 1, 2)) * (1 - span) + rng.random((60, 3, 2)) * span
    raster = rasterize(triangles.astype(np.float32), size)
    points = points_in(triangles, 300, rng)
    inside = points * (size[1], size[0]) % 1
    points = points[((inside > 0.002) & (inside < 0.998)).all(1)]  # a touch is none
    assert set(texels_of(points, size)) <= set(raster.texels)
    assert set(raster.triangles) <= set(range(60))


def test_slivers_and_points_have_texels_too():
    flat = np.array([[[0.1, 0.15], [0.9, 0.15], [0.5, 0.15]], [[0.3, 0.7]] * 3], np.float32)
    raster = rasterize(flat, (10, 10))
    assert set(raster.texels[raster.triangles == 0]) == {80 + x for x in range(1, 9)}
    assert (raster.triangles == 1).sum() == 1
    assert np.isfinite(raster.weights).all()
    np.testing.assert_allclose(raster.weights.sum(1), 1)


def test_what_lies_on_one_another_is_told():
    twice = np.concatenate((SQUARE / 2, SQUARE / 2, SQUARE / 2 + 0.5))
    raster = rasterize(twice, (32, 32))
    shared = raster.image(raster.shared[:, None].astype(np.float32))[..., 0]
    assert shared[16:, :16].mean() > 0.9, "lower left; diagonals are borders"
    assert not shared[:16].any()


def test_components_of_a_chain_and_a_ring():
    pairs = np.array([[0, 1], [1, 2], [5, 4], [4, 6], [6, 5]])
    np.testing.assert_array_equal(components(7, pairs), [0, 0, 0, 3, 4, 4, 4])


def grid(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a plane of `count` x `count` squares, facing up."""
    x, y = np.meshgrid(np.arange(count + 1), np.arange(count + 1))
    vertices = np.stack((x, y, 0 * x), -1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).reshape(-1)
    a, b, c, d = corner, corner + 1, corner + count + 2, corner + count + 1
    return vertices, np.concatenate((np.stack((a, b, c), 1), np.stack((a, c, d), 1)))


def ball(count: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of an octahedron made round, as seen from outside."""
    vertices = np.array(
        [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32
    )
    upper = [[i, (i + 1) % 4, 4] for i in range(4)]
    lower = [[(i + 1) % 4, i, 5] for i in range(4)]
    return vertices, np.array(upper + lower)[:count]


def test_a_body_turned_inside_out_is_told_and_parts_of_one():
    vertices, triangles = ball()
    assert not turned_in(vertices[triangles], triangles).any()
    inside_out = triangles[:, ::-1]
    assert turned_in(vertices[inside_out], inside_out).all()
    part = triangles.copy()
    part[[1, 6]] = part[[1, 6], ::-1]
    np.testing.assert_array_equal(np.flatnonzero(turned_in(vertices[part], part)), [1, 6])


def test_a_sheet_keeps_the_side_of_most_of_it():
    vertices, triangles = grid(4)
    assert not turned_in(vertices[triangles], triangles).any()
    down = triangles[:, ::-1].copy()
    assert not turned_in(vertices[down], down).any(), "which side is the outside nobody knows"
    down[3] = down[3, ::-1]
    np.testing.assert_array_equal(np.flatnonzero(turned_in(vertices[down], down)), [3])


def test_bodies_are_told_apart():
    vertices, triangles = ball()
    two = np.concatenate((triangles, triangles[:, ::-1] + 6))
    turned = turned_in(np.concatenate((vertices, vertices + 5))[two], two)
    np.testing.assert_array_equal(turned, [False] * 8 + [True] * 8)


def faces_of(vertices: np.ndarray, triangles: np.ndarray) -> Faces:
    return Faces(vertices[triangles], triangles, np.arange(len(triangles)))


def screw(turns: int = 3, steps: int = 24) -> Faces:
    """A spiral staircase: all of it looks up, and its turns lie above one another."""
    angle = np.arange(turns * steps + 1) * 2 * np.pi / steps
    ring = np.stack((np.cos(angle), np.sin(angle), 0.3 * angle), 1)
    vertices = np.concatenate((ring * (1, 1, 1), ring * (2, 2, 1))).astype(np.float32)
    a = np.arange(turns * steps)
    b = a + len(ring)
    triangles = np.concatenate((np.stack((a, b, a + 1), 1), np.stack((b, b + 1, a + 1), 1)))
    return faces_of(vertices, triangles)


@pytest.mark.parametrize(
    "meshes",
    [
        [faces_of(*ball())],
        [faces_of(*grid(5)), faces_of(*ball())],
        [screw()],
        [faces_of(*ball())] * 40,
    ],
)
def test_charts_lie_side_by_side_at_the_world_s_scale(meshes):
    places = laid_out(meshes, 256)
    assert [len(each) for each in places] == [len(mesh.corners) for mesh in meshes]
    uv = np.concatenate(places)
    assert uv.min() >= 0
    assert uv.max() <= 1
    raster = rasterize(uv, (256, 256))
    assert raster.shared.sum() <= 0.01 * raster.centers.sum()
    assert raster.centers.mean() > 0.5, "texels are made good use of"
    sides, lengths = (
        np.linalg.norm(values - np.roll(values, 1, 1), axis=2).ravel()
        for values in (uv, np.concatenate([mesh.corners for mesh in meshes]))
    )
    scale = sides / lengths
    assert scale.max() / np.median(scale) < 1.8, "as seen along an axis"


def test_more_faces_than_texels_have_no_charts():
    lone = np.arange(3 * 3000).reshape(-1, 3)
    corners = np.random.default_rng(0).random((3000, 3, 3)).astype(np.float32)
    assert laid_out([Faces(corners, lone, np.arange(3000))], 64) is None
