"""What a partly weathered material shows of how it weathers: `python -m training scan`.

What is clean and what is weathered is told apart (or a mask says it), the signed distance from the
border is the age, and a texel's past is what lies nearer to the border, plus what sets it apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .change import Change
from .curves import FARTHEST, Curves, curves_by_distance
from .distance import Wraps, padded, signed_distance, smoothed
from .onsets import correlation_length
from .quilting import quilted
from .relief import from_steps, without_form
from .scan_maps import HEIGHT, ScanMaps, read_scan
from .two_states import TwoStates, masked, two_states

__all__ = ("AGES", "Scan", "change_of", "read_states")

Array = NDArray[np.float32]

AGES = 64
"""Ages that a scan's history is told at: enough for a lip of lifted paint."""

_TILE = 512  # texels a side of a residue's tile, at the scan's own resolution
_DEEP = (0.8, 1.6)  # share of the way, and texels from the border: past its blur
_SHALLOW = 0.6  # share likewise, where little is deeper
_LEAST_DEEP = 2_000  # texels
_FORM = 16.0  # texels; a residue's height holds no larger waves
_BEYOND_LIPS = -8.0  # texels outside: what is raised at borders is no form
_JOINT = 5.0  # deviations below the median: no grain is as deep, gaps are
_MEDIAN_DEVIATION = 0.6745  # of a normal number
_BESIDE = 1.0  # texels beside a gap that belong to it
_MOST_STARTS = 50_000


@dataclass(frozen=True)
class Scan:
    """A scan whose two states are known: its `distance` [H, W] from the border in texels, above 0
    where it is weathered, and the `curves` that lead from one to the other.
    """

    maps: ScanMaps
    states: TwoStates
    distance: Array
    scale: float
    curves: Curves


def read_states(source: Path | ScanMaps, *, mask: Path | None = None, process: str = "") -> Scan:
    """The scan in `source` (see `read_scan`), what of it is weathered, and its curves.

    Raises InputError where it cannot be read or shows no two states.
    """
    maps = source if isinstance(source, ScanMaps) else read_scan(source)
    states = two_states(maps, process) if mask is None else masked(maps, mask)
    distance = signed_distance(states.weathered, maps.wraps, most=FARTHEST)
    scale = correlation_length(distance) or 1.0
    if maps.has_height:
        clean = distance < _BEYOND_LIPS
        values = maps.values.copy()
        values[..., HEIGHT] = without_form(
            values[..., HEIGHT], clean if clean.any() else distance < 0, maps.wraps
        )
        maps = replace(maps, values=values)
    return Scan(maps, states, distance, scale, curves_by_distance(maps.values, distance))


def change_of(
    scan: Scan, *, seed: int = 0, step: Callable[[float], None] = lambda fraction: None
) -> Change:
    """What `scan` shows: the mean history, how texels differ, and a tile of what the weathered ones
    have beyond their mean. `step` hears which share of the work is done.
    """
    curves, maps = scan.curves, scan.maps
    side = min(_TILE, max(maps.size))
    ages = np.linspace(0, 1, AGES, dtype=np.float32)
    distance = curves.distance_at(ages)
    gone = curves.share_at(distance)
    gone = (gone - gone[0]) / max(float(gone[-1] - gone[0]), 1e-6)
    mean = curves.mean_at(distance)
    residue = _weathered(scan, side, seed)
    end = np.append(residue[..., :HEIGHT].mean((0, 1)), curves.weathered[HEIGHT])
    residue -= residue.mean((0, 1))
    step(1.0)
    # It begins as what is farthest from the border, and ends as what the tile shows on average.
    before = (distance.clip(max=0) / curves.first)[:, None]
    after = (distance.clip(min=0) / curves.last)[:, None]
    mean += before * (curves.clean - mean[0]) + after * (end - mean[-1])
    mean += gone[:, None] * (ages[:, None] - 1) * curves.drift
    mean[:, HEIGHT] -= mean[0, HEIGHT]
    mean[:, HEIGHT] /= side
    clean = maps.values[scan.distance < min(curves.first, -1.0)]
    if len(clean) == 0:
        clean = maps.values[~scan.states.weathered]
    return Change(
        mean,
        gone,
        gone,
        clean[:: max(1, len(clean) // _MOST_STARTS), :HEIGHT].copy(),
        residue,
        share=side / max(maps.size),
        has_height=maps.has_height,
        scale=scan.scale,
        weathered=scan.states.fine,
        name=maps.name,
        told=(*maps.told, scan.states.told),
    )


def _weathered(scan: Scan, side: int, seed: int) -> Array:
    """A tile [side, side, 8] of weathered texels as they are, of whose height (in sides) only what
    is no form. Flecks and what varies toward the border are part of how they look. Of heights the
    slopes are joined: where patches meet that lie at different heights is no step.
    """
    curves, maps = scan.curves, scan.maps
    height = maps.values[..., HEIGHT] - curves.mean_at(scan.distance)[..., HEIGHT]
    height -= smoothed(height, _FORM, maps.wraps)
    around = padded(height, 1, maps.wraps)[1:, 1:]
    steps = np.diff(around, axis=0)[:, :-1], np.diff(around, axis=1)[:-1]
    values = np.concatenate((maps.values[..., :HEIGHT], np.stack(steps, -1)), -1)
    share, depth = _DEEP
    gone = curves.share_at(scan.distance)
    deep = (gone > share) & (scan.distance > depth)
    if deep.sum() < _LEAST_DEEP:
        deep = (gone > _SHALLOW) & (scan.distance > 0)
    deep &= ~_joints(height, deep, maps.wraps)
    tile = quilted(values, deep, maps.wraps, side, seed)
    height = from_steps(*np.moveaxis(tile[..., HEIGHT:], -1, 0))
    height -= smoothed(height, _FORM, (True, True))
    return np.concatenate((tile[..., :HEIGHT], height[..., None] / side), -1)


def _joints(height: Array, deep: NDArray[np.bool_], wraps: Wraps) -> NDArray[np.bool_]:
    """Where gaps between boards or tiles lie [H, W]: far below what is usual of `deep` texels."""
    middle = np.median(height[deep])
    deviation = np.median(np.abs(height[deep] - middle)) / _MEDIAN_DEVIATION
    below = (height < middle - _JOINT * deviation).astype(np.float32)
    return smoothed(below, _BESIDE, wraps) > 0.02
