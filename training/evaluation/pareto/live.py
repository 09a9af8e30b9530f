"""The figures that were asked for of live materials, from what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .results import Figure, Point
from .runs import Run

__all__ = ("live_figures",)

_MB = 1024  # of resident memory, in a GB
_FASTER = 5
_DISK = 12  # MB


def live_figures(
    points: Mapping[str, Point],
    runs: Mapping[str, Mapping[str, Run]],
    largest_run: Mapping[str, float],
    *,
    size: int,
    largest: int,
) -> list[Figure]:
    """Seconds, decibels and megabytes of live materials beside those of frames, by quality;
    `largest_run` (`pareto_probes.large_run`) is of one that is `largest` wide.
    """
    found = []
    for quality, seconds, least in (("draft", 0.6, 38), ("balanced", 1.2, 45)):
        name = f"{quality}, live"
        live, frames = runs[name], runs[quality]
        wall = _mean([run.wall for run in live.values()])
        core = _mean([run.core for run in live.values()])
        ratios = [
            (frames[each].wall / run.wall, frames[each].core / run.core)
            for each, run in live.items()
        ]
        faster, of_core = (_mean(ratio) for ratio in zip(*ratios, strict=True))
        wanted = _FASTER if quality == "balanced" else 1
        found.append(
            Figure(
                f"{name}, {size} x {size}",
                f"{seconds} s" + f" and >= {_FASTER} x faster than frames" * (wanted > 1),
                f"{wall:.2f} s by the clock, {core:.2f} core s; {faster:.1f} x faster than frames,"
                f" {of_core:.1f} x in core seconds",
                wall <= seconds and faster >= wanted,
            )
        )
        worst = {each: min(run.psnr) for each, run in live.items()}
        lowest = min(worst, key=worst.__getitem__)
        whole = [each for each, run in live.items() if run.frames]
        found.append(
            Figure(
                f"{name}, worst frame of every material",
                f">= {least} dB against exact",
                f"{worst[lowest]:.1f} dB ({lowest}), frames {points[quality].worst_frame:.1f}"
                + f"; as frames: {', '.join(whole)}" * bool(whole),
                worst[lowest] >= least and not whole,
            )
        )
        disk = [run.megabytes for run in live.values()]
        found.append(
            Figure(
                f"{name}, disk",
                f"<= {_DISK} MB a material",
                f"{_mean(disk):.1f} MB, the largest {max(disk):.1f};"
                f" frames {points[quality].megabytes:.0f}",
                max(disk) <= _DISK,
            )
        )
    memory = largest_run["peak_rss_mb"] / _MB
    found.append(
        Figure(
            f"balanced, live, {largest} x {largest}",
            "15 s, 3 GB, 200 MB",
            f"{largest_run['wall']:.1f} s by the clock, {largest_run['core']:.1f} core s,"
            f" {memory:.2f} GB, {largest_run['megabytes']:.0f} MB",
            largest_run["wall"] <= 15 and memory <= 3 and largest_run["megabytes"] <= 200,
        )
    )
    return found


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
