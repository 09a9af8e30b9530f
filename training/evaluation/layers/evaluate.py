"""What varnish does to what lies under it: random walks, and the laws that a model may learn from.

Of the same film `multiplied` is crossed twice and no more, exp(-2 d); `film` is the law of `films`,
by which yellowing is made. Both are held against walks in a few lit views, with the same highlight,
so that what differs is the color below. The ground is matte, the boundary glossy or satin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from model_runtime.brdf.views import other_views, psnr_of

from ...data.films import ground_under, seen_through
from ..bench import results
from ..bench.results import Result, write_report
from .walks import Film, Ground, boundary, evaluate_stack

__all__ = ("LayersReport", "evaluate_layers", "table")

Array = NDArray[np.floating]

_GROUNDS = {
    "white lead": (0.75, 0.72, 0.68),
    "red earth": (0.45, 0.20, 0.10),
    "azurite": (0.10, 0.20, 0.50),
    "bone black": (0.06, 0.05, 0.04),
}
_DEPTH = np.array([0.03, 0.11, 0.48])  # of varnish that has yellowed as far as ours does
_AGES = (0.0, 0.25, 0.5, 1.0)
_ROUGHNESS = (0.05, 0.15)  # alpha: glossy and satin
_IOR = 1.5
_PASSED = 1 - ((_IOR - 1) / (_IOR + 1)) ** 2  # as states count it: 1 - ks
_WALKS, _SEED = 64, 0
_MATTE = 0.5


@dataclass(frozen=True)
class Compared(Result):
    """PSNR in dB of each law, by ground, under a film of this alpha at this share of the depth."""

    JSON = (("alpha", None), ("age", None), ("multiplied", 1), ("film", 1))

    alpha: float
    age: float
    multiplied: list[float]
    film: list[float]


@dataclass(frozen=True)
class LayersReport(Result):
    """A row a film; dB are of the `grounds` in order."""

    JSON = (("grounds", None), ("rows", None))

    rows: list[Compared]
    grounds: tuple[str, ...] = tuple(_GROUNDS)


def evaluate_layers(output: Path, *, walks: int = _WALKS) -> LayersReport:
    """All grounds under films of all ages, by so many `walks` a pair of directions; writes
    `layers.json` and `.md` to a folder.
    """
    generator = torch.Generator().manual_seed(_SEED)
    bodies = np.array([*_GROUNDS.values()])
    report = LayersReport(
        [_compared(bodies, alpha, age, walks, generator) for alpha in _ROUGHNESS for age in _AGES]
    )
    output.mkdir(parents=True, exist_ok=True)
    write_report(output, "layers", [table(report)], report)
    return report


def _compared(
    bodies: Array, alpha: float, age: float, walks: int, generator: torch.Generator
) -> Compared:
    views, count = other_views(), len(bodies)
    under, depth = ground_under(bodies, _IOR), age * _DEPTH
    film = Film(
        torch.full((count,), alpha),
        torch.from_numpy(depth).float().expand(count, 3),
        _IOR,
    )
    ground = Ground(
        torch.from_numpy(under).float(), torch.zeros(count, 3), torch.full((count,), _MATTE)
    )
    truth = views.seen(evaluate_stack(film, ground, views.angles, walks=walks, generator=generator))
    top = boundary(film, views.angles)

    def decibels(body: Array) -> list[float]:
        below: Tensor = _PASSED / math.pi * torch.from_numpy(body).float()[:, None]
        return [round(each, 1) for each in psnr_of(truth, views.seen(top + below)).tolist()]

    return Compared(
        alpha,
        age,
        multiplied=decibels(bodies * np.exp(-2 * depth)),
        film=decibels(seen_through(under, depth, _IOR)),
    )


def table(report: LayersReport) -> str:
    """A row a film: dB of each ground by each law."""
    rows = []
    for row in report.rows:
        pairs = zip(row.multiplied, row.film, strict=True)
        cells = (f"{m}, **{f}**" if f > m else f"{m}, {f}" for m, f in pairs)
        rows.append([f"{row.alpha}", f"{row.age}", *cells])
    heads = [f"{name}: multiplied, film" for name in report.grounds]
    return results.table(["alpha", "age", *heads], rows)
