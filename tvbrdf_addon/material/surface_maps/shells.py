"""Which triangles hang together, and which of them were turned inside out.  Plain numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ("components", "neighbors", "turned_in")

Array = NDArray[np.float32]
Numbers = NDArray[np.int64]
Marks = NDArray[np.bool_]

# Of the sides of a shell's triangles, how many may be nobody else's before it is a sheet.
_OPEN = 0.05


def neighbors(vertices: Numbers) -> tuple[Numbers, Marks]:
    """Pairs of triangles [T, 3] that share a side with each other alone: their numbers [N, 2], and
    whether both go along it in the same direction [N], as they do where one is turned over.
    """
    starts, ends = vertices.reshape(-1), np.roll(vertices, -1, 1).reshape(-1)
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    sides = low * (int(high.max(initial=0)) + 1) + high
    order = np.argsort(sides, kind="stable")
    same = np.append(sides[order[1:]] == sides[order[:-1]], False)
    # Of three or more at a side none is the other's neighbor.
    more = np.roll(same, 1) | np.roll(same, -1)
    first = np.flatnonzero(same & ~more)
    a, b = order[first], order[first + 1]
    return np.stack((a // 3, b // 3), 1), starts[a] == starts[b]


def components(count: int, pairs: Numbers) -> Numbers:
    """Of `count` things, `pairs` [N, 2] of which are joined: the least of those that each hangs
    together with.
    """
    labels = np.arange(count)
    while len(pairs):
        found = labels[pairs]
        apart = found[:, 0] != found[:, 1]
        pairs, found = pairs[apart], found[apart]
        np.minimum.at(labels, found.max(1), found.min(1))
        while (labels != (further := labels[labels])).any():
            labels = further
    return labels


def turned_in(corners: Array, vertices: Numbers) -> Marks:
    """Which triangles [T, 3, 3], with `vertices` [T, 3], show their back to the outside: [T].

    Neighbors are turned alike.  A body's outside is where it encloses a volume, a sheet's is that
    of most of its area.  What has one side only (a Moebius strip) stays as it is.
    """
    count = len(vertices)
    pairs, opposed = neighbors(vertices)
    # Each triangle is there twice: as it is, and (its number + count) turned over.
    straight = pairs + [0, 1] * opposed[:, None] * count
    labels = components(2 * count, np.concatenate((straight, (straight + count) % (2 * count))))
    as_is, over = labels[:count], labels[count:]
    shells = np.minimum(as_is, over)
    # The side of its shell that a triangle shows as it is: 1 or -1.
    side = np.where(as_is <= over, 1, -1)
    areas, volumes = _areas_and_volumes(corners.astype(np.float64), shells)
    total, lone = _sum(shells, areas), 3 - np.bincount(pairs.reshape(-1), minlength=count)
    open_share = _sum(shells, lone) / np.maximum(3 * _sum(shells, np.ones(count)), 1)
    volume = _sum(shells, side * volumes)
    is_body = (open_share <= _OPEN) & (np.abs(volume) > 1e-3 * total**1.5)
    outside = np.where(is_body, volume, _sum(shells, side * areas))
    return (as_is != over) & (side * np.where(outside < 0, -1, 1)[shells] < 0)


def _areas_and_volumes(
    corners: NDArray[np.float64], shells: Numbers
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of triangles, and of the tetrahedra between them and their shells' centers."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    areas = np.linalg.norm(normal, axis=1) / 2
    middle = (a + b + c) / 3
    weight = np.maximum(_sum(shells, areas), 1e-30)
    center = np.stack([_sum(shells, areas * middle[:, k]) / weight for k in range(3)], 1)
    return areas, (normal * (middle - center[shells])).sum(1) / 6


def _sum(shells: Numbers, values: NDArray[np.generic]) -> NDArray[np.float64]:
    return np.bincount(shells, values, len(shells)).astype(np.float64)
