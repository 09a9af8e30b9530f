"""Small pictures of an object that show where aging starts, without a renderer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .atlas import Atlas

__all__ = ("seen_from",)

Array = NDArray[np.float32]

_SIDE = 256  # pixels
_FILLS = 0.46  # of a side: the radius of what is shown
_LIGHT = np.array((-0.4, -0.6, 0.7)) / np.linalg.norm((-0.4, -0.6, 0.7))
_AMBIENT = 0.5
_MOST_REACH = 4  # pixels to either side that a texel covers at most
# Onsets and their colors, dark for what is first; what never starts is blue.
_RAMP = (0.0, 0.25, 0.6, 0.999, 1.0)
_COLORS = np.array(
    ((0.3, 0.07, 0.02), (0.78, 0.3, 0.06), (0.97, 0.78, 0.4), (0.95, 0.94, 0.9), (0.5, 0.58, 0.66))
)


def seen_from(direction: tuple[float, float, float], atlas: Atlas, onset: Array) -> Array:
    """What is seen of a surface from a `direction` far away, its `onset` [h, w], 0 to 1, as colors:
    [256, 256, 4] of 0 to 1, nothing where nothing is.
    """
    size = onset.shape[0], onset.shape[1]
    covered = atlas.covered_at(size)
    places = atlas.places(covered, range(size[0]))
    normal = atlas.normal.reshape(-1, 3).take(places.baked, 0)
    toward = np.array(direction) / np.linalg.norm(direction)
    right = np.cross((0.0, 0.0, 1.0), toward)
    right /= np.linalg.norm(right)
    middle = (places.position.min(0) + places.position.max(0)) / 2
    apart = places.position - middle
    scale = _FILLS * _SIDE / max(float(np.linalg.norm(apart, axis=-1).max()), 1e-9)
    front = np.flatnonzero(normal @ toward > 0)
    x = _SIDE / 2 + scale * (apart[front] @ right)
    y = _SIDE / 2 - scale * (apart[front] @ np.cross(toward, right))
    color = _colors(onset.reshape(-1).take(places.texel[front]), normal[front], toward)

    reach = int(min(np.ceil(0.6 * scale * atlas.spacing_at(size)), _MOST_REACH))
    steps = range(-reach, reach + 1)
    picture = np.zeros((_SIDE * _SIDE, 4), np.float32)
    # Painted from the back to the front, those beside a texel's own pixel a little behind it.
    depth = apart[front] @ toward
    beside = [(down, across) for down in steps for across in steps]
    behind = [np.hypot(*step) / scale for step in beside]
    order = np.argsort(np.concatenate([depth - each for each in behind]), kind="stable")
    pixel = np.concatenate(
        [
            (y + down).astype(np.int64).clip(0, _SIDE - 1) * _SIDE
            + (x + across).astype(np.int64).clip(0, _SIDE - 1)
            for down, across in beside
        ]
    )
    picture[pixel[order]] = color[order % len(front)] if len(front) else 0
    return picture.reshape(_SIDE, _SIDE, 4)


def _colors(onset: Array, normal: Array, toward: NDArray[np.float64]) -> Array:
    """Opaque, lit from a little beside the eye: [n, 4]."""
    bright = _AMBIENT + (1 - _AMBIENT) * np.maximum(normal @ (toward + _LIGHT) / 2, 0)
    color = [np.interp(onset, _RAMP, channel) * bright for channel in _COLORS.T]
    return np.stack((*color, np.ones_like(bright)), -1).clip(0, 1).astype(np.float32)
