"""What the report `synthesis` found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..bench.results import Result, plain
from .domains import DomainResult

__all__ = ("CaseResult", "Curve", "LearningCurves", "SynthesisReport", "averaged")

LearningCurves = Mapping[str, Mapping[str, Sequence[tuple[float, float]]]]
"""By case and method: minutes of a core that the whole ladder took, and mean PSNR in dB."""


@dataclass(frozen=True)
class Curve(Result):
    """PSNR in dB of some `frames`, counted from 0, of a history of `length`.

    Frame 0 is given to the methods: it is shown in charts and in no number. Of dear methods not
    every frame is scored; between two that are, the curve is a line.
    """

    JSON = (("mean", 2), ("final", 2), ("min", 2))

    frames: tuple[int, ...]
    psnr: tuple[float, ...]
    length: int

    @property
    def every(self) -> np.ndarray:
        """PSNR of the frames 1 to the last."""
        first = int(self.frames[0] == 0)
        return np.interp(np.arange(1, self.length), self.frames[first:], self.psnr[first:])

    @property
    def mean(self) -> float:
        return float(self.every.mean())

    @property
    def final(self) -> float:
        return float(self.every[-1])

    @property
    def min(self) -> float:
        return float(self.every.min())


def averaged(curves: list[Curve]) -> Curve:
    """The mean of curves of the same length, over the frames that all have: of the materials of
    one case, of which a method may find some dear and others not.
    """
    assert len({curve.length for curve in curves}) == 1
    common = sorted(set.intersection(*(set(curve.frames) for curve in curves)))
    mean = [np.mean([c.psnr[c.frames.index(frame)] for c in curves]) for frame in common]
    return Curve(tuple(common), tuple(map(float, mean)), curves[0].length)


@dataclass(frozen=True)
class CaseResult(Result):
    """One case: `curves`, `ceilings` (of the representation alone), `after_fit` (of measured cases,
    as textures would hold it, and of `ours` by `two_lobes` and by `three_lobes`), `true_onset` and
    `statistics` (of cases with spots; see `spot_statistics`), by method; `clamped`, the share of
    the truth's values out of range; `chosen`, the rung that `ours` took for each material.
    """

    curves: Mapping[str, Curve]
    ceilings: Mapping[str, Curve] = field(default_factory=dict)
    after_fit: Mapping[str, Curve] = field(default_factory=dict)
    two_lobes: Mapping[str, Curve] = field(default_factory=dict)
    three_lobes: Mapping[str, Curve] = field(default_factory=dict)
    true_onset: Mapping[str, Curve] = field(default_factory=dict)
    statistics: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    chosen: Mapping[str, str] = field(default_factory=dict)
    clamped: float = 0.0

    def json(self) -> dict[str, Any]:
        """The numbers of every method; the curves in full."""
        rest = (
            *("ceilings", "after_fit", "two_lobes", "three_lobes"),
            *("true_onset", "statistics", "chosen"),
        )
        frames = {
            name: dict(zip(curve.frames, np.round(curve.psnr, 2).tolist(), strict=True))
            for name, curve in self.curves.items()
        }
        head = {"methods": self.curves, "frames": frames, "clamped": round(self.clamped, 4)}
        return plain(head | {name: found for name in rest if (found := getattr(self, name))})


@dataclass(frozen=True)
class SynthesisReport(Result):
    """Every case by name; minutes that one training of each method took; how the domain of each
    bundled NTM judges materials; PSNR by minutes of training.
    """

    JSON = (
        *(("cases", None), ("train_minutes", None), ("learning", None), ("domains", None)),
        *(("settings", None), ("seconds", 1)),
    )

    cases: Mapping[str, CaseResult]
    train_minutes: Mapping[str, float]
    settings: Mapping[str, Any]
    seconds: float
    domains: Mapping[str, DomainResult] = field(default_factory=dict)
    learning: LearningCurves = field(default_factory=dict)
