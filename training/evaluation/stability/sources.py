"""Stresses of the source: methods learn from sequences that are short, gappy or unsteady.

The target is undamaged; only what is learned can be wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...data.sequences import Sequence, uniform_times
from .trials import FRAMES, Stress, Trial, World, grown

__all__ = ("SOURCES",)

_SEED = 20240715
_OUTLIER = 17


def _frames(world: World, frames: float) -> Trial:
    """A source of so few frames."""
    source = grown(world.patches()[0], times=uniform_times(int(frames)))
    return _learning_from(world, source, f"{int(frames)}_frames")


def _gaps(world: World, share: float) -> Trial:
    """One gap in the middle of the source: a share of its time in which there are no frames."""
    times = uniform_times(FRAMES)
    source = _only(world.source, np.abs(times - 0.5) >= share / 2 - 1e-6)
    return _learning_from(world, source, f"gap_{share:g}")


def _flicker(world: World, percent: float) -> Trial:
    """Each frame's Kd and Ks times one random number, as a lamp that is not steady makes it."""
    rng = np.random.default_rng(_SEED)
    light = 1 + percent / 100 * rng.standard_normal((FRAMES, 1, 1, 1))
    return _learning_from(world, _lit(world.source, light), f"flicker_{percent:g}")


def _outlier(world: World, factor: float) -> Trial:
    """One frame in the middle so many times too bright."""
    light = np.ones((FRAMES, 1, 1, 1))
    light[_OUTLIER] = factor
    return _learning_from(world, _lit(world.source, light), f"outlier_{factor:g}")


def _lit(source: Sequence, light: NDArray[np.float64]) -> Sequence:
    lamp = np.maximum(light, 0).astype(np.float32)
    return replace(source, kd=source.kd * lamp, ks=source.ks * lamp)


def _only(source: Sequence, kept: NDArray[np.bool_]) -> Sequence:
    maps = {name: getattr(source, name)[kept] for name in ("kd", "ks", "alpha", "times")}
    return replace(source, **maps)


def _learning_from(world: World, source: Sequence, key: str) -> Trial:
    maps = ("kd", "ks", "alpha", "times")
    if all(np.array_equal(getattr(source, m), getattr(world.source, m)) for m in maps):
        return Trial(world.case())  # harmless: what is learned from the world's source already
    return Trial(world.case(source=source, key=key.replace(".", "")))


SOURCES: Mapping[str, Stress] = {
    "source_frames": Stress(
        "source with few frames", "frames", (36.0, 12.0, 3.0, 2.0), _frames,
        note="STT and STAF refuse fewer than four frames",
    ),
    "source_gap": Stress(
        "source with a gap", "share of the time without frames", (0.0, 0.3, 0.9), _gaps
    ),
    "source_flicker": Stress(
        "source that flickers", "standard deviation of its light, %",
        (0.0, 5.0, 20.0, 50.0), _flicker,
    ),
    "source_outlier": Stress(
        "source with one outlier frame", "times too bright", (1.0, 2.0, 100.0),
        _outlier,
    ),
}  # fmt: skip
"""By name."""
