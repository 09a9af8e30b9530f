"""A clear film over a ground that scatters light to all sides, as varnish on a painting.

Light enters through the boundary, crosses the film, is scattered by the ground, and leaves, or is
reflected inside and comes again: Saunderson's correction (Journal of the Optical Society of America
32, 1942) with a film that absorbs by Beer and Lambert's law, along the slanted ways that refraction
leaves to it. What the boundary itself reflects is not in it.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

__all__ = ("fresnel", "ground_under", "returned", "seen_through")

Array = NDArray[np.floating]

_STEPS = 4_000  # of cosines
_DEPTHS = np.concatenate(([0.0], np.geomspace(1e-3, 8.0, 120)))


def fresnel(cosine: Array, ior: float) -> Array:
    """Reflectance of a smooth boundary to a medium `ior` times as dense, for unpolarized light that
    has this cosine above 0; total inside where `ior` is below 1.
    """
    sine2 = (1 - cosine**2) / ior**2
    inside = np.sqrt(np.maximum(1 - sine2, 0))
    s = (cosine - ior * inside) / np.maximum(cosine + ior * inside, 1e-12)
    p = (ior * cosine - inside) / np.maximum(ior * cosine + inside, 1e-12)
    return np.where(sine2 >= 1, 1.0, (s**2 + p**2) / 2)


@cache
def _crossings(ior: float) -> tuple[Array, Array]:
    """By optical depth (`_DEPTHS`): of the light that passes the boundary the share that crosses
    the film, and of all that the ground scatters the share that comes back to it.
    """
    cosine = (np.arange(_STEPS) + 0.5) / _STEPS
    inside = np.sqrt(1 - (1 - cosine**2) / ior**2)
    enters = 2 * cosine * (1 - fresnel(cosine, ior))
    stays = 2 * cosine * fresnel(cosine, 1 / ior)
    depth = _DEPTHS[:, None]
    crosses = (enters * np.exp(-depth / inside)).sum(1) / enters.sum()
    return crosses, (stays * np.exp(-2 * depth / cosine)).mean(1)


def ground_under(body: Array, ior: float) -> Array:
    """The reflectance of a ground that looks like `body` [...], 0 to 1, under a clear film."""
    _, back = _crossings(ior)
    return body / (1 - back[0] * (1 - body))


def seen_through(ground: Array, depth: Array | float, ior: float) -> Array:
    """How a `ground` [...] looks under a film of this optical depth straight through (`depth`
    broadcasts), of what the boundary lets in: 0 to 1.
    """
    across, _ = _crossings(ior)
    crosses = np.interp(np.asarray(depth), _DEPTHS, across)
    inner = returned(0.0, ior)
    return crosses**2 * (1 - inner) * ground / (1 - returned(depth, ior) * ground)


def returned(depth: Array | float, ior: float) -> Array:
    """Of all that a ground scatters into a film of this optical depth, the share that comes back to
    it.
    """
    _, back = _crossings(ior)
    return np.interp(np.asarray(depth), _DEPTHS, back)
