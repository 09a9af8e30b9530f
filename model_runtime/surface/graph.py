"""Which points of a surface are neighbors, and how soon something that spreads arrives at each.

Neighbors lie near each other in space, across seams of the unwrapping and between objects that
touch, and face alike. Two that face away from each other are the two sides of a sheet, unless all
such lie to one side: then some faces are turned inside out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .points import Points, near_pairs

__all__ = ("NEIGHBORS", "Graph", "arrival", "join")

Array = NDArray[np.float32]
Index = NDArray[np.int64]

NEIGHBORS = 12

_REACH = 1.75  # of neighbors, in spacings: farther are gaps
_ALIKE = -0.2  # cosine between normals: from here on, up to a corner's and a little more
_TO_ONE_SIDE = 0.4  # of the mean distance: how far apart the middles of a border's two sides are
_MOST_SWEEPS = 4000


@dataclass(frozen=True, eq=False)
class Graph:
    """The neighbors of points, nearest first, [NEIGHBORS, n]; the point itself where there are
    fewer, at an infinite distance.
    """

    neighbor: NDArray[np.int32]
    distance: Array

    def between(self, values: Array) -> Array:
        """What the neighbors have more of than the point itself: [NEIGHBORS, n, ...]."""
        return values[self.neighbor] - values

    def smoothed(self, values: Array) -> Array:
        """The mean of each point's value and those of its neighbors: [n]."""
        known = np.isfinite(self.distance)
        return (values + values[self.neighbor].sum(0, where=known)) / (1 + known.sum(0))


@lru_cache(maxsize=1)
def join(points: Points, least: float = -np.inf) -> Graph:
    """The nearest neighbors of each point, of those that face alike and lie in reach; the last are
    kept, as the points are. From a cosine between normals below `least` on there is an edge, across
    which none are neighbors.
    """
    i, j = near_pairs(points.position, _REACH * points.spacing)
    apart = points.position[j] - points.position[i]
    length = np.maximum(np.linalg.norm(apart, axis=-1), 1e-3 * points.spacing)
    cosine = np.einsum("ij,ij->i", points.normal[i], points.normal[j])
    alike = cosine >= _ALIKE
    count = len(points)
    away, distance = apart[~alike], length[~alike]
    middle = np.stack([np.bincount(i[~alike], away[:, axis], count) for axis in range(3)], -1)
    usual = np.bincount(i[~alike], distance, count)
    border = np.linalg.norm(middle, axis=-1) > _TO_ONE_SIDE * usual
    along = np.abs(np.einsum("ij,ij->i", apart, points.normal[i])) < 0.5 * length
    kept = (alike | (border[i] & border[j] & along)) & (cosine >= least)
    i, j, length = i[kept], j[kept], length[kept]

    order = np.lexsort((length, i))
    i, j, length = i[order], j[order], length[order]
    rank = np.arange(len(i)) - np.searchsorted(i, np.arange(count))[i]
    near = rank < NEIGHBORS
    neighbor = np.tile(np.arange(count, dtype=np.int32), (NEIGHBORS, 1))
    distances = np.full((NEIGHBORS, count), np.inf, np.float32)
    neighbor[rank[near], i[near]] = j[near]
    distances[rank[near], i[near]] = length[near]
    return Graph(neighbor, distances)


def arrival(graph: Graph, births: Array, cost: Array) -> Array:
    """The first time that something born at `births` [n] arrives at each point, [n].

    `cost` [NEIGHBORS, n] is the time it takes from each neighbor: Bellman's equation, swept until
    nothing changes.
    """
    times = births
    for _ in range(_MOST_SWEEPS):
        updated = times
        for neighbor, step in zip(graph.neighbor, cost, strict=True):
            updated = np.minimum(updated, times.take(neighbor) + step)
        if np.array_equal(updated, times):
            break
        times = updated
    return times
