"""What the report `representation` found, and how it is written as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from torch import Tensor

from .sets import BAD_FITS, SEED

__all__ = ("Cell", "Cost", "MethodResult", "Picture", "Point", "Report")


@dataclass(frozen=True)
class Cell:
    """PSNR in dB of one method on the materials (or frames) of one set."""

    materials: dict[str, float]

    @property
    def mean(self) -> float:
        """Over all materials."""
        return float(np.mean(list(self.materials.values())))

    @property
    def judged(self) -> list[float]:
        """Without the materials whose truth is a bad fit: what can be a worst."""
        return [value for name, value in self.materials.items() if name not in BAD_FITS]

    @property
    def worst(self) -> float:
        """The lowest of `judged`."""
        return min(self.judged)

    def json(self) -> dict[str, Any]:
        """Mean and n over all materials, min and p5 over those that are judged."""
        return {
            "mean": round(self.mean, 2),
            "min": round(self.worst, 2),
            "p5": round(float(np.quantile(self.judged, 0.05)), 2),
            "n": len(self.materials),
            "materials": {name: round(value, 2) for name, value in self.materials.items()},
        }


@dataclass(frozen=True)
class Cost:
    """What a method takes: times are those of one core, in batches.

    samples, texel_samples: directions at which a uniform material and a texel are read
    """

    parameters: int
    latent_dims: int
    encode_ms: float
    decode_us_per_sample: float
    train_minutes: float | None
    train_iterations: int | None
    samples: int
    texel_samples: int


@dataclass(frozen=True)
class Point:
    """A method that reads `samples` directions (and spends `iterations` on a BRDF, if it trains):
    milliseconds to encode a BRDF, and the scores of some materials of the sets it applies to.
    """

    samples: int
    iterations: int | None
    encode_ms: float
    cells: dict[str, Cell]

    def json(self) -> dict[str, Any]:
        """The mean of each set."""
        means = {name: round(cell.mean, 2) for name, cell in self.cells.items()}
        return {
            "samples": self.samples,
            "iterations": self.iterations,
            "encode_ms": self.encode_ms,
            "mean": means,
        }


@dataclass(frozen=True)
class Picture:
    """Tone-mapped pixels [P, 3] of one material under one map, and its score in dB."""

    pixels: Tensor
    score: float


@dataclass(frozen=True)
class MethodResult:
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
        return {
            "sets": {name: cell.json() for name, cell in self.cells.items()},
            **vars(self.cost),
            "curve": [point.json() for point in self.curve],
            "progress": list(self.progress),
            "properties": self.properties,
        }


@dataclass(frozen=True)
class Report:
    """Every method by name, on spheres `pixels` wide; `truth` holds the pictures to compare with,
    of the pixels `inside` [S, S].
    """

    methods: dict[str, MethodResult]
    truth: dict[tuple[str, str], Tensor]
    inside: Tensor
    seconds: float

    @property
    def pixels(self) -> int:
        """Width of the spheres."""
        return len(self.inside)

    def json(self) -> dict[str, Any]:
        """The content of `representation.json`."""
        return {
            "metric": {"pixels": self.pixels, "seed": SEED, "bad_fits": list(BAD_FITS)},
            "seconds": round(self.seconds, 1),
            "methods": {name: method.json() for name, method in self.methods.items()},
        }
