"""Grain on a surface: laid by where its texels lie in space, so that it goes on across seams."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..temporal.grain import Grain
from ..temporal.processes import growth_of
from .atlas import MOST_KEPT, Atlas
from .growth import usual_unit

__all__ = ("lay_grain", "tile_side")

_TILES = 2.0  # material tiles to a unit of growth
_CHUNK = 1 << 18  # texels of a step


def tile_side(
    atlas: Atlas, process: str, share: float, *, pattern_size: float | None = None
) -> float:
    """Meters: the side of a tile that covers a `share` of a material tile's.

    A material tile is half as long as what `process` calls a tile's side when it grows: two fifths
    of the root of the surface's area. So a can and Blender's monkey, on which it is 1.4 m long of
    2.7 m, show as many spots, and spots as many grains. A `pattern_size` of an artist's makes both
    finer, but none coarser: a few huge patches are no closer look.
    """
    unit = usual_unit(float(atlas.area.sum(dtype=np.float64)))
    if pattern_size is not None:
        unit = min(unit, pattern_size / growth_of(process, None).scale)
    return share * unit / _TILES


def lay_grain(
    grain: Grain, atlas: Atlas, size: tuple[int, int], *, side: float, seed: int
) -> NDArray[np.float16]:
    """Components [K, H W] of a map of `size` of the surface that `atlas` shows, where the grain's
    tile has a `side` in meters; what no face covers has those of the nearest texel.
    """
    example = _Example(grain.tile.tobytes(), grain.table.tobytes(), grain)
    if size[0] * size[1] > MOST_KEPT:
        return _laid.__wrapped__(example, atlas, size, side, seed)
    return _laid(example, atlas, size, side, seed).copy()  # what is kept is nobody's to change


@dataclass(frozen=True)
class _Example:
    """A grain by what its components follow from."""

    tile: bytes
    table: bytes
    grain: Grain = field(compare=False)


@lru_cache(maxsize=1)
def _laid(
    example: _Example, atlas: Atlas, size: tuple[int, int], side: float, seed: int
) -> NDArray[np.float16]:
    """The components; the last are kept, as when texels start changes more often."""
    covered = atlas.covered_at(size)
    texel = atlas.spacing_at(size)
    normal = atlas.normal.reshape(-1, 3)
    components = np.zeros((len(example.grain.tile), covered.size), np.float16)
    step = max(1, _CHUNK // size[1])
    chunks = [range(row, min(row + step, size[0])) for row in range(0, size[0], step)]
    for rows in chunks:
        places = atlas.places(covered, rows)
        facing = normal.take(places.baked, 0)
        found = example.grain.on_surface(places.position, facing, side, seed, texel=texel)
        components[:, places.texel] = found.T
    for rows in chunks:
        beside, source = atlas.beside(covered, rows)
        components[:, beside] = components[:, source]
    return components
