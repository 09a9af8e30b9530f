"""What the report `representation` found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from torch import Tensor

from ..bench.results import Result, plain
from .sets import BAD_FITS, SEED

__all__ = ("Cell", "Cost", "MethodResult", "Picture", "Point", "Report")


@dataclass(frozen=True)
class Cell(Result):
    """PSNR in dB of one method on the materials (or frames) of one set: mean and n over all, min
    and p5 without those whose truth is a bad fit.
    """

    JSON = (("mean", 2), ("min", 2), ("p5", 2), ("n", None), ("materials", 2))

    materials: dict[str, float]

    @property
    def n(self) -> int:
        return len(self.materials)

    @property
    def mean(self) -> float:
        return float(np.mean(list(self.materials.values())))

    @property
    def min(self) -> float:
        return min(self._judged)

    @property
    def p5(self) -> float:
        return float(np.quantile(self._judged, 0.05))

    @property
    def _judged(self) -> list[float]:
        return [value for name, value in self.materials.items() if name not in BAD_FITS]


@dataclass(frozen=True)
class Cost:
    """What a method takes: times are those of one core, in batches.

    samples, texel_samples: directions at which a uniform material and a texel are read
    refine_ms: what reading a measured BRDF takes where it is checked, and looked at again if off
    """

    parameters: int
    latent_dims: int
    encode_ms: float
    decode_us_per_sample: float
    train_minutes: float | None
    train_iterations: int | None
    samples: int
    texel_samples: int
    refine_ms: float | None = None


@dataclass(frozen=True)
class Point(Result):
    """A method that reads `samples` directions (and spends `iterations` on a BRDF, if it trains):
    milliseconds to encode a BRDF, and the scores of some materials of the sets it applies to.
    """

    JSON = (("samples", None), ("iterations", None), ("encode_ms", None), ("mean", 2))

    samples: int
    iterations: int | None
    encode_ms: float
    cells: dict[str, Cell]

    @property
    def mean(self) -> dict[str, float]:
        """Of each set."""
        return {name: cell.mean for name, cell in self.cells.items()}


@dataclass(frozen=True)
class Picture:
    """Tone-mapped pixels [P, 3] of one material under one map, and its score in dB."""

    pixels: Tensor
    score: float


@dataclass(frozen=True)
class MethodResult(Result):
    """One method: its sets, its cost, its curve of accuracy over samples, its pictures (by set and
    material), what its training saw of itself (see `Progress`), and its properties (see
    `measure_properties`)."""

    cells: dict[str, Cell]
    cost: Cost
    curve: tuple[Point, ...]
    pictures: dict[tuple[str, str], Picture]
    progress: tuple[Mapping[str, float], ...] = ()
    properties: Mapping[str, Any] = field(default_factory=dict)

    def json(self) -> dict[str, Any]:
        """As the report's reader expects it."""
        rest = {name: getattr(self, name) for name in ("curve", "progress", "properties")}
        return plain({"sets": self.cells, **vars(self.cost), **rest})


@dataclass(frozen=True)
class Report(Result):
    """Every method by name, on spheres `pixels` wide; `truth` holds the pictures to compare with,
    of the pixels `inside` [S, S].
    """

    JSON = (("metric", None), ("seconds", 1), ("methods", None))

    methods: dict[str, MethodResult]
    truth: dict[tuple[str, str], Tensor]
    inside: Tensor
    seconds: float

    @property
    def pixels(self) -> int:
        """Width of the spheres."""
        return len(self.inside)

    @property
    def metric(self) -> dict[str, Any]:
        """How scores were made."""
        return {"pixels": self.pixels, "seed": SEED, "bad_fits": BAD_FITS}
