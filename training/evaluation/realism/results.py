"""What the report `realism` found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ...metric.texture import LAYERS, Textures
from ..bench.results import Result

__all__ = ("Compared", "Figure", "RealismReport", "Target")


@dataclass(frozen=True)
class Compared(Result):
    """How far a method's picture is from a target; `time`, 0 to 1, when it was taken, None of
    scans; `seconds` of a core that it took to age the material.
    """

    JSON = (("distance", 3), ("layers", 3), ("time", 2), ("seconds", 1))

    found: Textures
    time: float | None = None
    seconds: float | None = None

    @property
    def distance(self) -> float:
        """Mean over the layers."""
        return self.found.distance

    @property
    def layers(self) -> dict[str, float]:
        """By layer."""
        return dict(zip(LAYERS, self.found.layers, strict=True))


@dataclass(frozen=True)
class Target(Result):
    """One picture to be met, and how near methods come; `learned`: seconds that ours took to learn
    from the source.
    """

    JSON = (("methods", None), ("learned", 1))

    methods: Mapping[str, Compared]
    learned: float | None = None


@dataclass(frozen=True)
class Figure(Result):
    """A figure that was asked for; `met` is None where nothing was asked."""

    JSON = (("name", None), ("asked", None), ("measured", None), ("met", None))

    name: str
    asked: str
    measured: str
    met: bool | None


@dataclass(frozen=True)
class RealismReport(Result):
    """By name: targets; how far scans of rust are from each other; what relief and spots were found
    to be; what copper's film costs methods to learn and to play.
    """

    JSON = (
        *(("figures", None), ("targets", None), ("rusts", 3), ("relief", 3), ("spots", 3)),
        *(("costs", 3), ("settings", None), ("seconds", 1)),
    )

    figures: tuple[Figure, ...]
    targets: Mapping[str, Target]
    rusts: Mapping[str, Mapping[str, float]]
    relief: Mapping[str, Any]
    spots: Mapping[str, Any]
    costs: Mapping[str, Any]
    settings: Mapping[str, Any]
    seconds: float = field(default=0.0)
