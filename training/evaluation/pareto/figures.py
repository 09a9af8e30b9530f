"""The figures that were asked for, and what each saving is worth, from what was measured."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from model_runtime.contract import EXACT, LSTM_LATENTS

from .exact import Exact
from .live import live_figures
from .results import Figure, Point, Saving
from .runs import Run
from .settings import LATENTS
from .truth import TruthRun

__all__ = ("Probes", "exact_point", "figures", "savings")

_MB = 1024  # of resident memory, in a GB


@dataclass(frozen=True)
class Probes:
    """What is measured once.

    large: by map size, `wall` and `core` seconds and `peak_rss_mb` of a run in a process of its own
    frames: that these runs wrote; usual: the same of one with all frames, at the usual size; live:
        of a live material at the largest, and `megabytes`
    worker: seconds from click to progress, `cold` and `warm`
    uniform: `core` seconds and `megabytes` of a `uniform` material and of the same as `texture`
    paper: core seconds of the paper's pipeline for a texel and its frames
    """

    large: Mapping[int, Mapping[str, float]]
    frames: int
    usual: Mapping[str, float]
    live: Mapping[str, float]
    worker: Mapping[str, float]
    uniform: Mapping[str, Mapping[str, float]]
    paper: float


def exact_point(
    name: str, base: Point, exact: Sequence[Exact], texels: int, truth: TruthRun
) -> Point:
    """Every texel for itself: `base`, its modelling replaced by that of `exact`, which was timed on
    fewer than the `texels` of a map.
    """
    each = sum(one.seconds for one in exact) / sum(len(one.rows) for one in exact)
    stages = {stage: base.core_of(stage) for stage in base.stages} | {"model": each * texels}
    return replace(
        base,
        name=name,
        knob="",
        core=sum(stages.values()),
        wall=None,
        stages=stages,
        psnr=dict.fromkeys(base.psnr, 100.0),
        worst_frame=100.0,
        entries=float(texels),
        truth=truth,
        extrapolated=True,
    )


def figures(
    points: Mapping[str, Point],
    runs: Mapping[str, Mapping[str, Run]],
    probes: Probes,
    *,
    latents_seconds: float,
    size: int,
    frames: int,
) -> list[Figure]:
    """The issue's table. `latents_seconds` is what exact takes for a texel in latents, of a core;
    `runs` are by setting and material.
    """
    found = []
    for name, seconds, least, each in (("draft", 3, 38, False), ("balanced", 10, 45, True)):
        point = points[name]
        assert point.wall is not None and point.mean is not None
        worst = min(point.psnr.values())
        psnr = worst if each else point.mean
        asked = f"{seconds} s and >= {least} dB against exact" + " on every material" * each
        measured = (
            f"{point.wall:.1f} s by the clock, {point.core:.1f} core s; {point.mean:.1f} dB,"
            f" worst material {worst:.1f}"
        )
        met = point.wall <= seconds and psnr >= least
        found.append(Figure(f"{name}, {size} x {size}, {frames} frames", asked, measured, met))

    whole = latents_seconds * size**2
    factor = probes.paper / latents_seconds
    exact, paper = points.get("latents exact"), points.get("paper")
    near = ""
    if exact and paper and exact.truth_mean is not None and paper.truth_mean is not None:
        near = (
            f" at {exact.truth_mean:.1f} dB against the truth, the paper's {paper.truth_mean:.1f}"
        )
    found.append(
        Figure(
            f"{EXACT}, {LSTM_LATENTS}",
            ">= 1,000 x the paper's pipeline at its PSNR",
            f"{whole / 3600:.1f} core hours to model {size} x {size}; {factor:,.0f} x faster"
            + near,
            factor >= 1000,
            extrapolated=True,
        )
    )
    quick = (
        (points.get("latents, every texel"), "every texel in latents, estimated instead of fitted"),
        (_cheapest_as_good(points, paper), "cheapest setting with the paper's PSNR"),
    )
    for point, name in quick:
        if point is None or paper is None or not (point.truth and paper.truth):
            continue
        factor = paper.truth.seconds / point.truth.seconds
        found.append(
            Figure(
                name,
                ">= 1,000 x the paper's pipeline at its PSNR",
                f"{point.name}: {factor:,.0f} x faster at {point.truth_mean:.1f} dB against the"
                f" truth, the paper's {paper.truth_mean:.1f}",
                factor >= 1000 and (point.truth_mean or 0) >= (paper.truth_mean or 0),
                extrapolated=True,
            )
        )
    ratios = [
        (run.wall / run.writing[0], run.core / run.writing[1])
        for run in runs["balanced"].values()
        if run.writing
    ]
    wall, core = (sum(ratio) / len(ratios) for ratio in zip(*ratios, strict=True))
    found.append(
        Figure(
            "balanced against writing the same EXRs from memory",
            "<= 3 x",
            f"{wall:.2f} x by the clock, {core:.2f} x in core seconds",
            wall <= 3,
        )
    )
    found.append(_memory(f"memory, {size}, {frames} frames", probes.usual, 2))
    largest = max(probes.large)
    large = _memory(f"memory, {largest}, {probes.frames} frames", probes.large[largest], 4)
    found.append(large)
    found.append(_growth(probes))
    found.append(
        Figure(
            "warm worker, click to first progress message",
            "<= 0.2 s",
            f"{probes.worker['warm']:.3f} s warm; {probes.worker['cold']:.1f} s from a cold start",
            probes.worker["warm"] <= 0.2,
        )
    )
    return found + live_figures(points, runs, probes.live, size=size, largest=largest)


def savings(points: Mapping[str, Point], probes: Probes) -> list[Saving]:
    """Each with and without, all else being as in `balanced` (or in the setting `latents`)."""

    fitted = "latents, fitted"
    found = [
        Saving("palette, modelling", "core s", *_models(points, "exact", "balanced")),
        Saving("palette, modelling latents", "core s", *_models(points, "latents exact", fitted)),
        Saving("estimator", "core s", *_models(points, fitted, LATENTS)),
        Saving("encoder's short cut", "core s", *_models(points, "latents, m = 258", LATENTS)),
    ]
    for name, without, with_it in (
        ("sparse frames", "balanced", "sparse"),
        ("every 3rd frame", "balanced", "every 3rd frame"),
        ("aged every 3rd frame", "balanced", "aged every 3rd frame"),
        ("ZIP", "uncompressed", "balanced"),
        ("half the size", "balanced", "size / 2"),
        ("live", "balanced", "balanced, live"),
    ):
        one, other = points[without], points[with_it]
        found.append(Saving(name, "core s", one.core, other.core))
        found.append(Saving(name, "MB", one.megabytes or 0.0, other.megabytes or 0.0))
        found.append(Saving(name, "dB against exact", one.mean or 0.0, other.mean or 0.0))
    texture, uniform = probes.uniform["texture"], probes.uniform["uniform"]
    found.append(Saving("uniform material", "core s", texture["core"], uniform["core"]))
    found.append(Saving("uniform material", "MB", texture["megabytes"], uniform["megabytes"]))
    return found


def _models(points: Mapping[str, Point], without: str, with_it: str) -> tuple[float, float]:
    return points[without].core_of("model"), points[with_it].core_of("model")


def _memory(name: str, run: Mapping[str, Any], gigabytes: int) -> Figure:
    peak = run["peak_rss_mb"] / _MB
    return Figure(name, f"<= {gigabytes} GB", f"{peak:.2f} GB", peak <= gigabytes)


def _growth(probes: Probes) -> Figure:
    """From the smallest to the largest; and from each to the next, since small maps take a time
    that does not grow.
    """
    sizes, core = sorted(probes.large), {size: run["core"] for size, run in probes.large.items()}
    linear = (sizes[-1] / sizes[0]) ** 2
    growth = core[sizes[-1]] / core[sizes[0]]
    steps = ", ".join(f"{core[b] / core[a]:.1f} x to {b}" for a, b in itertools.pairwise(sizes))
    return Figure(
        f"growth of time from {sizes[0]} to {sizes[-1]}, {probes.frames} frames",
        f"<= {linear:g} x, as the texels",
        f"{growth:.1f} x in core seconds ({steps})",
        growth <= linear,
    )


def _cheapest_as_good(points: Mapping[str, Point], paper: Point | None) -> Point | None:
    """The setting with at least the paper's PSNR against the truth that models fastest."""
    if paper is None or paper.truth_mean is None:
        return None
    good = [
        point
        for point in points.values()
        if point.panel != "rival"
        and point.truth is not None
        and (point.truth_mean or 0) >= paper.truth_mean
    ]
    return min(good, key=lambda point: point.truth.seconds if point.truth else 0.0, default=None)
