"""Which texels of a scan are weathered: two kinds of surface told apart, or what a mask says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model_runtime.errors import InputError
from model_runtime.images import read_image
from model_runtime.resampling import resize

from ..data.kinetics import PROCESSES, history
from .scan_maps import ROUGHNESS, ScanMaps, features

__all__ = ("TwoStates", "masked", "two_states")

Array = NDArray[np.float32]
Mask = NDArray[np.bool_]

_SAMPLED = 20_000
_ROUNDS = 40
_APART = 0.035  # distance of the two means: a step that one sees
_FINEST = 0.09  # share of neighbors that differ: a figure, a weave, noise
_FEWEST = 0.01  # share of the smaller kind
_METAL, _ROUGH = 0.1, 0.01
_NOTHING = "{name} shows no two states to learn from: {why}."
_HINT = "Give a material that is weathered in places and clean in others, or a --mask."


@dataclass(frozen=True)
class TwoStates:
    """weathered: [H, W]; fine: the same of each texel by itself, whatever those around it are
    told: in a sentence, by what; sampled: [n, 5] features of some texels and which of them are
    weathered [n], for charts.
    """

    weathered: Mask
    fine: Mask
    told: str
    sampled: tuple[Array, Mask]


def masked(maps: ScanMaps, mask: Path) -> TwoStates:
    """What `mask`, an image of any size, says: weathered where it is brighter than half."""
    weathered = resize(read_image(mask, color=False), maps.size) > 0.5
    share = weathered.mean()
    if not _FEWEST <= share <= 1 - _FEWEST:
        raise InputError(
            f"The mask {'covers all' if share > 0.5 else 'leaves nothing'} of {maps.name}.",
            "Paint what is weathered white, and leave what is clean black.",
        )
    seen = _some(features(maps), weathered)
    return TwoStates(weathered, weathered, "The mask says what is weathered.", seen)


def two_states(maps: ScanMaps, process: str = "") -> TwoStates:
    """The two kinds of surface that `maps` shows; InputError where there are none.

    Which is the weathered one: where the formula of `process` is known, the one that it leads to
    from the other; else the one that is less of a metal, or, where they are equally metallic, the
    rougher one.
    """
    seen = features(maps)
    centers = _centers(seen[::2, ::2].reshape(-1, seen.shape[-1]))
    way = centers[1] - centers[0]
    second, apiece = (
        (each - centers.mean(0)) @ way > 0 for each in (seen, features(maps, sharp=True))
    )
    apart = float(np.linalg.norm(way))
    if apart < _APART:
        raise _none(maps, "its texels are of one kind")
    share = float(second.mean())
    if not _FEWEST <= share <= 1 - _FEWEST:
        raise _none(maps, "nearly all of it is of one kind")
    # every other texel: what changes from one to the next is no border of what has weathered
    coarse = second[::2, ::2]
    fine = np.mean([np.mean(np.diff(coarse, axis=axis)) for axis in (0, 1)])
    if fine > _FINEST:
        raise _none(maps, "what differs in it is as fine as a weave or noise")
    metal = float(maps.metal[~second].mean() - maps.metal[second].mean())
    first, other = (maps.values[some].mean(0) for some in (~second, second))
    first_weathers, told = _weathered(first, other, metal, process)
    weathered, apiece = (~second, ~apiece) if first_weathers else (second, apiece)
    return TwoStates(weathered, apiece, told, _some(seen, weathered))


def _none(maps: ScanMaps, why: str) -> InputError:
    return InputError(_NOTHING.format(name=maps.name, why=why), _HINT)


def _centers(points: Array) -> Array:
    """Two means [2, F] of points [n, F] (Lloyd 1982), from the halves of their widest spread."""
    some = points[:: max(1, len(points) // _SAMPLED)].astype(np.float64)
    centered = some - some.mean(0)
    widest = np.linalg.svd(centered, full_matrices=False)[2][0]
    second = centered @ widest > 0
    centers = np.stack((some.mean(0), some.mean(0)))
    for _ in range(_ROUNDS):
        if second.all() or not second.any():
            break
        centers = np.stack((some[~second].mean(0), some[second].mean(0)))
        nearer = (some - centers.mean(0)) @ (centers[1] - centers[0]) > 0
        if (nearer == second).all():
            break
        second = nearer
    return centers.astype(np.float32)


def _weathered(first: Array, second: Array, metal: float, process: str) -> tuple[bool, str]:
    """Whether the first of two mean texels [8], by `metal` the more metallic one, is weathered, and
    by what it is told.
    """
    if process in PROCESSES:
        away = [
            np.linalg.norm(np.sqrt(_aged(process, start)) - np.sqrt(np.maximum(end[:7], 0)))
            for start, end in ((second, first), (first, second))
        ]
        return bool(away[0] < away[1]), f"What is weathered is what {process} leads to."
    if abs(metal) > _METAL:
        return bool(metal < 0), "What is weathered is the less metallic part."
    rough = first[ROUGHNESS] - second[ROUGHNESS]
    if abs(rough) > _ROUGH:
        return bool(rough > 0), "What is weathered is the rougher part."
    light = first[:ROUGHNESS].sum() - second[:ROUGHNESS].sum()
    return bool(light < 0), "What is weathered is the darker part, as nothing else tells."


def _aged(process: str, start: Array) -> Array:
    """kd, ks and r [7] of a texel of which the formula of `process` has made all it will."""
    kd, ks, alpha = history(process, start[:3], start[3:6], start[6] ** 2, np.ones((), np.float32))
    return np.concatenate((kd, ks, [np.sqrt(alpha)])).clip(0)


def _some(seen: Array, weathered: Mask) -> tuple[Array, Mask]:
    flat = seen.reshape(-1, seen.shape[-1])
    step = max(1, len(flat) // _SAMPLED)
    return flat[::step], weathered.ravel()[::step]
