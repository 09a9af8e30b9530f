"""The figures that were asked for, and what each saving is worth, from what was measured."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from model_runtime.contract import EXACT, LSTM_LATENTS

from .exact import Exact
from .results import Figure, Point, Saving, mean_of
from .runs import Run
from .settings import LATENTS
from .truth import TruthRun

__all__ = ("Probes", "distinct_texels", "each_texel", "exact_point", "figures", "savings")

_MB = 1024  # of resident memory, in a GB
_DISK = 12  # MB of a live material
_ASKED = ">= 1,000 x the paper's pipeline at its PSNR"


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


def each_texel(exact: Sequence[Exact]) -> float:
    """Seconds of a core that modeling a texel exactly takes."""
    return mean_of([one.seconds for one in exact])


def distinct_texels(exact: Sequence[Exact]) -> float:
    """How many texels of a map differ."""
    return mean_of([one.distinct for one in exact])


def exact_point(name: str, base: Point, exact: Sequence[Exact], truth: TruthRun) -> Point:
    """Every texel for itself: `base`, its modeling replaced by that of `exact`, which was timed on
    fewer texels than a map has.
    """
    texels = distinct_texels(exact)
    stages = {stage: base.core_of(stage) for stage in base.stages}
    stages["model"] = each_texel(exact) * texels
    return replace(
        base,
        name=name,
        knob="",
        core=sum(stages.values()),
        wall=None,
        stages=stages,
        psnr=dict.fromkeys(base.psnr, 100.0),
        worst_frame=100.0,
        entries=texels,
        truth=truth,
        extrapolated=True,
    )


def figures(
    points: Mapping[str, Point],
    runs: Mapping[str, Mapping[str, Run]],
    probes: Probes,
    *,
    latents_seconds: float,
    distinct: float,
    size: int,
    frames: int,
) -> list[Figure]:
    """The issue's table. `latents_seconds` is what exact takes for a texel in latents, of a core,
    `distinct` how many texels of a map differ; `runs` are by setting and material.
    """
    largest = max(probes.large)
    return [
        _quality(points["draft"], f"{size} x {size}, {frames} frames", 3, 38, each=False),
        _quality(points["balanced"], f"{size} x {size}, {frames} frames", 10, 45, each=True),
        *_latents(points, probes, latents_seconds, distinct, size),
        _writing(list(runs["balanced"].values())),
        _memory(f"memory, {size}, {frames} frames", probes.usual, 2),
        _memory(f"memory, {largest}, {probes.frames} frames", probes.large[largest], 4),
        _growth(probes),
        Figure(
            "warm worker, click to first progress message",
            "<= 0.2 s",
            f"{probes.worker['warm']:.3f} s warm; {probes.worker['cold']:.1f} s from a cold start",
            probes.worker["warm"] <= 0.2,
        ),
        *_live("draft", points, runs, size, 0.6, 38, faster=1),
        *_live("balanced", points, runs, size, 1.2, 45, faster=5),
        _large_live(probes.live, largest),
    ]


def _quality(point: Point, what: str, seconds: int, least: int, *, each: bool) -> Figure:
    """Seconds and decibels of a whole run; of `each` material, or in the mean."""
    assert point.wall is not None and point.mean is not None
    worst = min(point.psnr.values())
    asked = f"{seconds} s and >= {least} dB against exact" + " on every material" * each
    measured = (
        f"{point.wall:.1f} s by the clock, {point.core:.1f} core s; {point.mean:.1f} dB,"
        f" worst material {worst:.1f}"
    )
    met = point.wall <= seconds and (worst if each else point.mean) >= least
    return Figure(f"{point.name}, {what}", asked, measured, met)


def _latents(
    points: Mapping[str, Point], probes: Probes, seconds: float, distinct: float, size: int
) -> list[Figure]:
    """Against the paper's pipeline: exact, estimated, and whatever is cheapest. Exact is held to it
    texel by texel, though of a map it models only those that differ.
    """
    exact, paper = points.get("latents exact"), points.get("paper")
    near = ""
    if exact and paper and exact.truth_mean is not None and paper.truth_mean is not None:
        near = (
            f" at {exact.truth_mean:.1f} dB against the truth, the paper's {paper.truth_mean:.1f}"
        )
    factor, minutes = probes.paper / seconds, seconds * distinct / 60
    measured = (
        f"{factor:,.0f} x faster a texel{near}; {minutes:.1f} core minutes to model {size} x"
        f" {size}, of whose texels {distinct / size**2:.0%} differ"
    )
    found = [
        Figure(f"{EXACT}, {LSTM_LATENTS}", _ASKED, measured, factor >= 1000, extrapolated=True)
    ]
    quick = {
        "every texel in latents, estimated instead of fitted": points.get("latents, every texel"),
        "cheapest setting with the paper's PSNR": _cheapest_as_good(points, paper),
    }
    for name, point in quick.items():
        if point is None or paper is None or not (point.truth and paper.truth):
            continue
        factor, psnr = paper.truth.seconds / point.truth.seconds, point.truth_mean or 0
        measured = (
            f"{point.name}: {factor:,.0f} x faster at {point.truth_mean:.1f} dB against the"
            f" truth, the paper's {paper.truth_mean:.1f}"
        )
        met = factor >= 1000 and psnr >= (paper.truth_mean or 0)
        found.append(Figure(name, _ASKED, measured, met, extrapolated=True))
    return found


def _cheapest_as_good(points: Mapping[str, Point], paper: Point | None) -> Point | None:
    """The setting with at least the paper's PSNR against the truth that models fastest."""
    if paper is None or paper.truth_mean is None:
        return None
    good = [
        point
        for point in points.values()
        if point.panel != "rival" and point.truth and (point.truth_mean or 0) >= paper.truth_mean
    ]
    return min(good, key=lambda point: point.truth.seconds if point.truth else 0.0, default=None)


def _writing(runs: Sequence[Run]) -> Figure:
    written = [run for run in runs if run.writing]
    wall = mean_of([run.wall / run.writing[0] for run in written if run.writing])
    core = mean_of([run.core / run.writing[1] for run in written if run.writing])
    measured = f"{wall:.2f} x by the clock, {core:.2f} x in core seconds"
    return Figure(
        "balanced against writing the same EXRs from memory", "<= 3 x", measured, wall <= 3
    )


def _memory(name: str, run: Mapping[str, float], gigabytes: int) -> Figure:
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


def _live(
    quality: str,
    points: Mapping[str, Point],
    runs: Mapping[str, Mapping[str, Run]],
    size: int,
    seconds: float,
    least: int,
    *,
    faster: int,
) -> list[Figure]:
    """Seconds, decibels and megabytes of live materials beside those of frames."""
    name = f"{quality}, live"
    live, frames, point = runs[name], runs[quality], points[quality]
    wall, core = mean_of([r.wall for r in live.values()]), mean_of([r.core for r in live.values()])
    by_wall = mean_of([frames[each].wall / run.wall for each, run in live.items()])
    by_core = mean_of([frames[each].core / run.core for each, run in live.items()])
    worst = {each: min(run.psnr) for each, run in live.items()}
    lowest = min(worst, key=worst.__getitem__)
    whole = [each for each, run in live.items() if run.frames]
    disk = [run.megabytes for run in live.values()]
    return [
        Figure(
            f"{name}, {size} x {size}",
            f"{seconds} s" + f" and >= {faster} x faster than frames" * (faster > 1),
            f"{wall:.2f} s by the clock, {core:.2f} core s; {by_wall:.1f} x faster than frames,"
            f" {by_core:.1f} x in core seconds",
            wall <= seconds and by_wall >= faster,
        ),
        Figure(
            f"{name}, worst frame of every material",
            f">= {least} dB against exact",
            f"{worst[lowest]:.1f} dB ({lowest}), frames {point.worst_frame:.1f}"
            + f"; as frames: {', '.join(whole)}" * bool(whole),
            worst[lowest] >= least and not whole,
        ),
        Figure(
            f"{name}, disk",
            f"<= {_DISK} MB a material",
            f"{mean_of(disk):.1f} MB, the largest {max(disk):.1f}; frames {point.megabytes:.0f}",
            max(disk) <= _DISK,
        ),
    ]


def _large_live(run: Mapping[str, float], width: int) -> Figure:
    memory = run["peak_rss_mb"] / _MB
    return Figure(
        f"balanced, live, {width} x {width}",
        "15 s, 3 GB, 200 MB",
        f"{run['wall']:.1f} s by the clock, {run['core']:.1f} core s, {memory:.2f} GB,"
        f" {run['megabytes']:.0f} MB",
        run["wall"] <= 15 and memory <= 3 and run["megabytes"] <= 200,
    )


def savings(points: Mapping[str, Point], probes: Probes) -> list[Saving]:
    """Each with and without, all else being as in `balanced` (or in the setting `latents`)."""
    fitted = "latents, fitted"
    found = [
        Saving("palette, modeling", "core s", *_models(points, "exact", "balanced")),
        Saving("palette, modeling latents", "core s", *_models(points, "latents exact", fitted)),
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
