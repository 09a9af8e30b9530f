"""What the report `pareto` found."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ..bench.results import Result, plain
from .runs import Run
from .settings import Setting
from .truth import TruthRun

__all__ = (
    "Figure",
    "ParetoReport",
    "Point",
    "Saving",
    "better_than",
    "mean_of",
    "point_of",
    "with_fronts",
)

_NOISE = (0.03, 0.1)
"""Share of the seconds by which a quiet machine's own runs differ, and dB that nobody sees."""


def mean_of(values: Collection[float]) -> float:
    return sum(values) / len(values)


@dataclass(frozen=True)
class Point(Result):
    """One way to age, over all materials.

    panel: "whole" or "latents", whose points are compared (`pareto_settings`); "rival" otherwise
    core, wall: seconds of a whole command, of one core and by the clock; means over the materials
    stages: wall seconds of each
    psnr: dB against exact by material, a mean over the compared frames; none of rivals
    worst_frame: the lowest PSNR of any frame of any material
    extrapolated: whether the seconds are partly worked out from fewer texels
    front, truth_front: whether no other of the panel is faster and as near to exact; and, in
    modeling alone, to the truth
    beaten_by: those of the panel that are, where it is not on the front
    """

    name: str
    knob: str
    panel: str
    core: float
    wall: float | None
    stages: Mapping[str, float]
    psnr: Mapping[str, float]
    worst_frame: float | None
    megabytes: float | None
    entries: float | None
    frames: float | None
    truth: TruthRun | None
    extrapolated: bool = False
    front: bool = False
    truth_front: bool = False
    beaten_by: Sequence[str] = ()

    @property
    def mean(self) -> float | None:
        """dB against exact over the materials."""
        return mean_of(self.psnr.values()) if self.psnr else None

    def core_of(self, stage: str) -> float:
        """Core seconds of a stage: its share of all, as the clock has it."""
        return self.core * self.stages[stage] / sum(self.stages.values())

    @property
    def truth_mean(self) -> float | None:
        """dB against the truth over the cases."""
        return mean_of(self.truth.psnr.values()) if self.truth else None

    @property
    def seconds(self) -> Mapping[str, Any]:
        return plain({"core": self.core, "wall": self.wall, "stages": self.stages}, 3)

    @property
    def against_exact(self) -> Mapping[str, Any]:
        worst = min(self.psnr, key=self.psnr.__getitem__) if self.psnr else None
        found = {
            "mean": self.mean,
            "worst": None if worst is None else self.psnr[worst],
            "worst_material": worst,
            "worst_frame": self.worst_frame,
            "materials": self.psnr,
        }
        return plain(found, 2)

    @property
    def against_truth(self) -> Mapping[str, Any] | None:
        if self.truth is None:
            return None
        mean = plain(self.truth_mean, 2)
        return {**vars(self.truth), "mean": mean, "front": self.truth_front}

    def json(self) -> dict[str, Any]:
        """An entry of `points` in `pareto.json`."""
        return plain(
            {
                "name": self.name,
                "knob": self.knob,
                "panel": self.panel,
                "seconds": self.seconds,
                "extrapolated": self.extrapolated,
                "psnr": self.against_exact,
                "front": self.front,
                "beaten_by": self.beaten_by,
                "bytes": None if self.megabytes is None else round(self.megabytes * 1e6),
                "entries": plain(self.entries, 1),
                "frames_written": plain(self.frames, 1),
                "truth": self.against_truth,
            }
        )


@dataclass(frozen=True)
class Figure(Result):
    """A figure that was asked for. `met` is None where there was nothing to reach."""

    JSON = (
        *(("name", None), ("asked", None), ("measured", None)),
        *(("met", None), ("extrapolated", None)),
    )

    name: str
    asked: str
    measured: str
    met: bool | None
    extrapolated: bool = False


@dataclass(frozen=True)
class Saving(Result):
    """What is saved by not modeling or storing everything: core seconds, megabytes and, where it
    costs any, dB against exact, `without` it and `with` it.
    """

    name: str
    unit: str
    without: float
    with_it: float

    def json(self) -> dict[str, Any]:
        """An entry of `savings`."""
        numbers = {"without": self.without, "with": self.with_it}
        return {"name": self.name, "unit": self.unit, **plain(numbers, 3)}


@dataclass(frozen=True)
class ParetoReport(Result):
    """All points, figures and savings, and what further lobes of measured materials cost and gain
    (`lobe_rows`); on what machine and how they were measured.
    """

    JSON = tuple(
        (n, None) for n in ("points", "figures", "savings", "lobes", "machine", "settings")
    )

    points: Sequence[Point]
    figures: Sequence[Figure]
    savings: Sequence[Saving]
    lobes: Sequence[Mapping[str, Any]]
    machine: Mapping[str, Any]
    settings: Mapping[str, Any] = field(default_factory=dict)


def point_of(setting: Setting, runs: Mapping[str, Run], truth: TruthRun | None) -> Point:
    """The means of a setting's `runs`, by material."""
    every = list(runs.values())
    return Point(
        name=setting.name,
        knob=setting.knob,
        panel=setting.panel,
        core=mean_of([run.core for run in every]),
        wall=mean_of([run.wall for run in every]),
        stages={stage: mean_of([run.stages[stage] for run in every]) for stage in every[0].stages},
        psnr={material: mean_of(run.psnr) for material, run in runs.items()},
        worst_frame=min(min(run.psnr) for run in every),
        megabytes=mean_of([run.megabytes for run in every]),
        entries=mean_of([run.entries for run in every]),
        frames=mean_of([run.frames for run in every]),
        truth=truth,
    )


def better_than(
    costs: Sequence[float], gains: Sequence[float], *, noise: tuple[float, float] = _NOISE
) -> list[list[int]]:
    """By point, the places of those that are at least as good in both, and better in one by more
    than `noise`: a share of the seconds, or so many dB. Those without any make the Pareto front.
    """
    share, least = noise
    both = list(enumerate(zip(costs, gains, strict=True)))
    return [
        [
            place
            for place, (c, g) in both
            if c <= cost and g >= gain and (c < cost * (1 - share) or g > gain + least)
        ]
        for _, (cost, gain) in both
    ]


def with_fronts(points: Sequence[Point]) -> list[Point]:
    """The points, told which are on a front."""
    found = {point.name: point for point in points}
    for panel in {point.panel for point in points}:
        shown = [p for p in points if p.panel == panel and p.mean is not None]
        better = better_than([p.core for p in shown], [p.mean or 0.0 for p in shown])
        for point, places in zip(shown, better, strict=True):
            names = [shown[place].name for place in places]
            found[point.name] = replace(found[point.name], front=not names, beaten_by=names)
    known = [p for p in points if p.truth is not None]
    better = better_than(
        [p.truth.seconds for p in known if p.truth], [p.truth_mean or 0.0 for p in known]
    )
    for point, places in zip(known, better, strict=True):
        found[point.name] = replace(found[point.name], truth_front=not places)
    return list(found.values())
