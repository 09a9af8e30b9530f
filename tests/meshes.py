"""Small unwrapped meshes and the maps that a baker would make of them, in numpy alone.

A mesh is patches of surface, each with a rectangle of the map as its island. Edges, crevices and
sky are what geometry says: how near an edge or another part is, and how far a face looks up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from model_runtime.surface.atlas import Atlas

__all__ = (
    "BOLTED",
    "BOLTS",
    "Patch",
    "atlas_of",
    "ball",
    "below_and_beside",
    "bolted_wall",
    "box",
    "pipe",
    "quad",
    "rank_correlation",
    "turned_inside_out",
    "write_vectors",
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Patch:
    """A piece of surface: places [..., 3] of the unit square (down, across), the right way round
    where the cross product of the two directions is the normal.

    rim: whether its border is an edge of the object
    """

    place: Callable[[Array, Array], Array]
    rim: bool = False

    def normal(self, v: Array, u: Array) -> Array:
        h = 1e-4
        down = self.place(v + h, u) - self.place(v - h, u)
        normal = np.cross(down, self.place(v, u + h) - self.place(v, u - h))
        return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def quad(corner: Sequence[float], down: Sequence[float], across: Sequence[float]) -> Patch:
    a, b, c = (np.asarray(each, float) for each in (corner, down, across))
    return Patch(lambda v, u: a + v[..., None] * b + u[..., None] * c, rim=True)


def box(center: Sequence[float], size: Sequence[float]) -> list[Patch]:
    """Six islands."""
    half = np.asarray(size, float) / 2
    patches = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            out, a, b = (np.zeros(3) for _ in range(3))
            out[axis] = sign
            a[(axis + 1) % 3], b[(axis + 2) % 3] = 1.0, sign
            corner = np.asarray(center) + (out - a - b) * half
            patches.append(quad(corner, 2 * a * half, 2 * b * half))
    return patches


def ball(center: Sequence[float], radius: float) -> list[Patch]:
    """A sphere of six islands."""

    def on_sphere(flat: Patch) -> Patch:
        def place(v: Array, u: Array) -> Array:
            cube = np.tan(flat.place(v, u) * (np.pi / 4))
            return center + radius * cube / np.linalg.norm(cube, axis=-1, keepdims=True)

        return Patch(place)

    return [on_sphere(flat) for flat in box((0, 0, 0), (2, 2, 2))]


def pipe(center: Sequence[float], radius: float, length: float) -> list[Patch]:
    """An upright tube of two islands, open at its ends."""

    def half(start: float) -> Patch:
        def place(v: Array, u: Array) -> Array:
            angle = np.pi * (start + u)
            ring = np.stack((radius * np.cos(angle), radius * np.sin(angle), -length * v), -1)
            return ring + center + np.array((0, 0, length / 2))

        return Patch(place)

    return [half(0.0), half(1.0)]


def turned_inside_out(patch: Patch) -> Patch:
    return Patch(lambda v, u: patch.place(v, 1 - u), patch.rim)


def atlas_of(
    patches: Sequence[Patch], size: int, *, margin: float = 0.006, reach: float = 0.1
) -> Atlas:
    """Maps of `size`, the patches side by side on them, `margin` of the side around each.

    `edges` rise within `reach` meters of a patch's rim.
    """
    across = int(np.ceil(np.sqrt(len(patches))))
    rows = int(np.ceil(len(patches) / across))
    position, normal = np.zeros((2, size, size, 3), np.float32)
    covered = np.zeros((size, size), bool)
    edges = np.zeros((size, size), np.float32)
    y, x = ((each + 0.5) / size for each in np.indices((size, size)))
    for number, patch in enumerate(patches):
        top, left = number // across / rows + margin, number % across / across + margin
        v, u = (y - top) / (1 / rows - 2 * margin), (x - left) / (1 / across - 2 * margin)
        inside = (v >= 0) & (v <= 1) & (u >= 0) & (u <= 1)
        v, u = v[inside], u[inside]
        position[inside], normal[inside] = patch.place(v, u), patch.normal(v, u)
        covered |= inside
        if patch.rim:
            sides = [(np.zeros_like(v), u), (np.ones_like(v), u), (v, 0 * u), (v, 1 + 0 * u)]
            away = [
                np.linalg.norm(patch.place(*side) - position[inside], axis=-1) for side in sides
            ]
            edges[inside] = (1 - np.min(away, 0) / reach).clip(0)
    features = {"sky": (0.5 + 0.5 * normal[..., 2]) * covered}
    if edges.any():
        features["edges"] = edges
    return Atlas(position, normal, covered, (0.0, 0.0, 0.0), features)


def write_vectors(path: Path, vectors: np.ndarray, alpha: np.ndarray | None = None) -> None:
    """An OpenEXR file of single floats, [H, W, 3] and where given alpha [H, W]."""
    channels = {
        name: np.ascontiguousarray(vectors[..., k], np.float32) for k, name in enumerate("RGB")
    }
    if alpha is not None:
        channels["A"] = np.ascontiguousarray(alpha, np.float32)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(path))


def rank_correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Spearman's, ties sharing their mean rank."""

    def ranks(values: np.ndarray) -> np.ndarray:
        _, inverse, count = np.unique(values, return_inverse=True, return_counts=True)
        return (np.cumsum(count) - (count - 1) / 2)[inverse]

    return float(np.corrcoef(ranks(a), ranks(b))[0, 1])


BOLTS = (0.3, 0.7)
BOLTED = [
    quad((0, 0, 1), (0, 0, -1), (1, 0, 0)),
    *(patch for x in BOLTS for patch in ball((x, 0, 0.8), 0.03)),
]
"""A wall with two bolts, at these places along it."""


def bolted_wall(size: int) -> Atlas:
    """Maps of that wall, where the bolts are of iron and the wall hardly rusts."""
    atlas = atlas_of(BOLTED, size)
    late = np.where(np.abs(atlas.position[..., 1]) < 0.01, 0.5, 0) * atlas.covered
    return replace(atlas, features=atlas.features | {"blocked": late.astype(np.float32)})


def below_and_beside(atlas: Atlas) -> tuple[np.ndarray, np.ndarray]:
    """Which texels of it lie a little below a bolt, and which at their height beside both."""
    x, y, z = np.moveaxis(atlas.position, -1, 0)
    away = np.min([np.abs(x - each) for each in BOLTS], 0)
    low = atlas.covered & (np.abs(y) < 0.01) & (z < 0.7) & (z > 0.55)
    return low & (away < 0.025), low & (away > 0.12)
