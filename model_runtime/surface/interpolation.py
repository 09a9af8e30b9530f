"""From the points of a surface to any place on it: smooth, and exact for what changes evenly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .graph import Graph
from .points import Points

__all__ = ("Interpolation",)

Array = NDArray[np.float32]

_NEIGHBORS = 8  # of the point that stands for a place, beside it
_REACH = 1.5  # spacings beyond which a point has no say
_FIRM = 1e-3  # of the spread of neighbors, so that slopes across a plane are none


@dataclass(frozen=True)
class Interpolation:
    """Values [n, F] of points, each with the plane that fits its neighbors' best.

    planes: position, then for each value its level at the origin and its slopes, [n, 3 + 4 F]
    near: the point itself and its neighbors, [n, 9]
    """

    planes: Array
    near: NDArray[np.int32]
    reach: float

    @property
    def count(self) -> int:
        """F."""
        return (self.planes.shape[1] - 3) // 4

    @classmethod
    def of(cls, points: Points, graph: Graph, values: Array) -> Interpolation:
        frames = _Frames.of(points, graph)
        moments = np.einsum("nki,knf->nif", frames.apart, graph.between(values))
        slope = (frames.solved(moments) / points.spacing).astype(np.float32)
        level = values - np.einsum("nif,ni->nf", slope, points.position)
        plane = np.concatenate((level[:, None], slope), 1).transpose(0, 2, 1)
        planes = np.concatenate((points.position, plane.reshape(len(points), -1)), 1)
        return cls(planes, frames.near, _REACH * points.spacing)

    def at(self, position: Array, point: NDArray[np.int32]) -> Array:
        """The values at positions [m, 3], near which these points lie: [F, m]."""
        place = np.ascontiguousarray(position.T)
        near = np.ascontiguousarray(self.near.take(point, 0).T)
        total, weights = np.zeros((self.count, len(position)), np.float32), np.float32(1e-12)
        for neighbor in near:
            there = np.ascontiguousarray(self.planes.take(neighbor, 0).T)
            squared = sum((place[axis] - there[axis]) ** 2 for axis in range(3))
            weight = np.maximum(1 - squared * np.float32(1 / self.reach**2), 1e-6)
            weight *= weight
            weights = weights + weight
            for value in range(self.count):
                level, x, y, z = there[3 + 4 * value : 7 + 4 * value]
                total[value] += weight * (level + x * place[0] + y * place[1] + z * place[2])
        return total / weights


@dataclass(frozen=True)
class _Frames:
    """How the neighbors of each point lie around it, which fits a plane to values.

    apart: spacings that each neighbor lies away, [n, NEIGHBORS, 3]
    adjugate, determinant: of what these spread over, [n, 3, 3] and [n]
    near: as in `Interpolation`
    """

    apart: Array
    adjugate: NDArray[np.float64]
    determinant: NDArray[np.float64]
    near: NDArray[np.int32]

    @staticmethod
    @lru_cache(maxsize=1)
    def of(points: Points, graph: Graph) -> _Frames:
        """The last are kept, as the points are."""
        known = np.isfinite(graph.distance)
        apart = graph.between(points.position).transpose(1, 0, 2) / points.spacing
        apart *= known.T[..., None]
        spread = np.einsum("nki,nkj->nij", apart, apart)
        firm = _FIRM * np.trace(spread, axis1=1, axis2=2) + 1e-6
        spread += firm[:, None, None] * np.eye(3, dtype=np.float32)
        # Cramer's rule for symmetric [n, 3, 3]: one by one LAPACK is slower.
        a, b, c = spread.astype(np.float64).transpose(1, 0, 2)
        adjugate = np.stack((np.cross(b, c), np.cross(c, a), np.cross(a, b)), 2)
        determinant = np.einsum("ni,ni->n", a, adjugate[..., 0])
        own = np.arange(len(points), dtype=np.int32)
        near = np.concatenate((own[None], graph.neighbor[:_NEIGHBORS]))
        return _Frames(apart, adjugate, determinant, np.ascontiguousarray(near.T))

    def solved(self, moments: Array) -> NDArray[np.float64]:
        """The slopes [n, 3, F] that fit best, of `moments` likewise."""
        return np.einsum("nij,njf->nif", self.adjugate, moments) / self.determinant[:, None, None]
