"""The report's charts: PSNR by material, over time of encoding, and over a texture's history."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .damages import DAMAGE_TITLES
from .methods import METHODS
from .results import MethodResult, Point, Report
from .sets import BAD_FITS, FRAMES, UNIFORM

__all__ = (
    "SET_TITLES",
    "chart_frames",
    "chart_materials",
    "chart_progress",
    "chart_speed",
    "chart_stability",
)

SET_TITLES = {
    "merl_seen": "MERL, seen",
    "merl_held_out": "MERL, held out",
    "rgl": "RGL, unseen",
    "bsdf": "real .bsdf",
    "disney": "Disney",
    "torrance_sparrow": "Torrance-Sparrow",
    "tvbtf45": "tvBTF45",
    "snowyground": "SnowyGround",
}
_MEASURED = ("merl_seen", "merl_held_out", "rgl")


def chart_materials(report: Report, path: Path) -> bool:
    """The paper's figure 5: a dot a material and method, sorted by the first method, dotted means.
    Writes nothing and returns False where there is nothing to draw.
    """
    sets = _present(report, UNIFORM)
    if not sets:
        return False
    columns = min(3, len(sets))
    rows = -(-len(sets) // columns)
    figure = Figure(figsize=(10, 2.9 * rows + 0.7), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    for ax, name in zip(axes, sets, strict=False):
        _materials(ax, report, name)
    for ax in axes[len(sets) :]:
        ax.set_visible(False)
    for ax in axes[::columns]:
        ax.set_ylabel("PSNR (dB)")
    _legend(figure, report)
    figure.savefig(path, dpi=100)
    return True


def _materials(ax: Axes, report: Report, name: str) -> None:
    shown = {key: m.cells[name].materials for key, m in report.methods.items() if name in m.cells}
    first = next(iter(shown.values()))
    order = sorted(first, key=first.__getitem__)
    few = len(order) <= 5
    for key, scores in shown.items():
        entry = METHODS[key]
        values = [scores[material] for material in order]
        x = np.arange(1, len(order) + 1)
        size = 40 if few else 11
        good = np.array([material not in BAD_FITS for material in order])
        style = {"s": size, "marker": entry.marker, "linewidths": 0.8, "edgecolors": entry.color}
        ax.scatter(x[good], np.array(values)[good], c=entry.color, **style)
        ax.scatter(x[~good], np.array(values)[~good], facecolors="none", **style)
        ax.axhline(float(np.mean(values)), color=entry.color, linestyle=":", linewidth=1.3)
    ax.set_title(f"{SET_TITLES[name]} ({len(order)})", fontsize=10)
    if few:
        ax.set_xticks(np.arange(1, len(order) + 1), order, fontsize=7, rotation=12)
        ax.set_xlim(0.4, len(order) + 0.6)
    else:
        ax.set_xlabel(f"materials, sorted by {METHODS[next(iter(shown))].title}", fontsize=9)
    ax.grid(axis="y", color="#dddddd", linewidth=0.6)


def chart_speed(report: Report, path: Path) -> bool:
    """Time to encode a BRDF against accuracy, a curve a method; the larger marker is the method as
    the tables have it. Writes nothing and returns False where there is nothing to draw.
    """
    panels = [
        ("analytic and real .bsdf", lambda name: name not in _MEASURED),
        ("measured: MERL seen, held out, RGL", lambda name: name in _MEASURED),
    ]
    panels = [panel for panel in panels if any(_points(m, panel[1]) for m in _methods(report))]
    if not panels:
        return False
    figure = Figure(figsize=(10, 4.9), layout="constrained")
    axes = figure.subplots(1, len(panels), squeeze=False, sharex=True, sharey=True)[0]
    for ax, (title, wanted) in zip(axes, panels, strict=True):
        for key, method in report.methods.items():
            _speed(ax, key, method.cost.samples, _points(method, wanted))
        ax.set_xscale("log")
        ax.margins(x=0.12, y=0.1)
        ax.set_title(title, fontsize=10)
        ax.set_xlabel("time to encode a BRDF on one core (ms)")
        ax.grid(which="major", color="#dddddd", linewidth=0.6)
    axes[0].set_ylabel("mean PSNR (dB)")
    _legend(figure, report)
    figure.savefig(path, dpi=100)
    return True


def _points(method: MethodResult, wanted: Callable[[str], bool]) -> list[tuple[Point, float]]:
    """The curve's points and their means over all materials of the sets `wanted`."""
    found = []
    for point in method.curve:
        values = [
            value
            for name, cell in point.cells.items()
            if wanted(name)
            for value in cell.materials.values()
        ]
        if values:
            found.append((point, float(np.mean(values))))
    return found


def _speed(ax: Axes, key: str, samples: int, points: list[tuple[Point, float]]) -> None:
    """A solid line over directions; for a method that trains, over iterations, and a dashed one
    over directions.
    """
    entry = METHODS[key]
    longest = max((point.iterations or 0 for point, _ in points), default=0)
    full = [(p, value) for p, value in points if (p.iterations or 0) == longest]
    trained = [(p, value) for p, value in points if longest and p.samples == samples]
    for line, dashes in ((trained, "-"), (full, "--" if longest else "-")):
        ax.plot(
            [p.encode_ms for p, _ in line],
            [value for _, value in line],
            color=entry.color,
            marker=entry.marker,
            markersize=4,
            linestyle=dashes,
            linewidth=1.4,
        )
    for i, (point, value) in enumerate(full):
        own = point.samples == samples
        if i > 0 and not own:
            continue
        if own:
            ax.plot(
                [point.encode_ms],
                [value],
                color=entry.color,
                marker=entry.marker,
                markersize=10,
                markeredgecolor="black",
            )
        ax.annotate(
            f"m = {point.samples:,}",
            (point.encode_ms, value),
            xytext=(0, 9 if own else -14),
            textcoords="offset points",
            ha="center",
            fontsize=8,
            color=entry.color,
        )


def chart_frames(report: Report, path: Path) -> bool:
    """The paper's figure 6: a score a frame of the two time-varying textures. Writes nothing and
    returns False where there is nothing to draw.
    """
    sets = _present(report, FRAMES)
    if not sets:
        return False
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    axes = figure.subplots(1, len(sets), squeeze=False, sharey=True)[0]
    for ax, name in zip(axes, sets, strict=True):
        for key, method in report.methods.items():
            if name in method.cells:
                frames = method.cells[name].materials
                times = [float(label.removeprefix("t = ")) for label in frames]
                entry = METHODS[key]
                ax.plot(times, list(frames.values()), color=entry.color, marker=entry.marker)
        ax.set_title(SET_TITLES[name], fontsize=10)
        ax.set_xlabel("time (share of the whole history)")
        ax.grid(color="#dddddd", linewidth=0.6)
    axes[0].set_ylabel("PSNR (dB)")
    _legend(figure, report)
    figure.savefig(path, dpi=100)
    return True


def chart_progress(report: Report, path: Path) -> bool:
    """PSNR of seen and unseen measured materials while the encoders were trained. Writes nothing
    and returns False where there is nothing to draw.
    """
    runs = {key: m.progress for key, m in report.methods.items() if m.progress}
    if not runs:
        return False
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    axes = figure.subplots(1, len(_MEASURED), squeeze=False, sharey=True)[0]
    for ax, name in zip(axes, _MEASURED, strict=True):
        for key, looks in runs.items():
            entry = METHODS[key]
            minutes = [look["minutes"] for look in looks]
            ax.plot(minutes, [look[name] for look in looks], color=entry.color, marker=entry.marker)
        ax.set_title(SET_TITLES[name], fontsize=10)
        ax.set_xlabel("minutes of one core")
        ax.grid(color="#dddddd", linewidth=0.6)
    axes[0].set_ylabel("PSNR of small spheres (dB)")
    _legend(figure, report)
    figure.savefig(path, dpi=100)
    return True


def chart_stability(report: Report, path: Path) -> bool:
    """Accuracy over damage to what an encoder reads, a panel a damage. Writes nothing and returns
    False where there is nothing to draw.
    """
    results = {key: m.properties["stability"] for key, m in report.methods.items() if m.properties}
    if not results:
        return False
    titles = DAMAGE_TITLES
    figure = Figure(figsize=(10, 6.2), layout="constrained")
    axes = figure.subplots(2, -(-len(titles) // 2), sharey=True)
    for ax, (name, title) in zip(axes.flat, titles.items(), strict=False):
        for key, damages in results.items():
            entry, curve = METHODS[key], damages[name]
            known = [(x, y) for x, y in enumerate(curve["mean"]) if y is not None]
            ax.plot(*zip(*known, strict=True), color=entry.color, marker=entry.marker, markersize=4)
            ax.set_xticks(range(len(curve["labels"])), curve["labels"], fontsize=7, rotation=20)
        ax.set_title(title, fontsize=10)
        ax.grid(color="#dddddd", linewidth=0.6)
    for row in axes:
        row[0].set_ylabel("PSNR (dB)")
    _legend(figure, report)
    figure.savefig(path, dpi=100)
    return True


def _methods(report: Report) -> Sequence[MethodResult]:
    return list(report.methods.values())


def _present(report: Report, names: Sequence[str]) -> list[str]:
    """Those of the sets `names` that any method has a score on."""
    return [name for name in names if any(name in m.cells for m in _methods(report))]


def _legend(figure: Figure, report: Report) -> None:
    handles = [
        Line2D(
            [], [], color=METHODS[key].color, marker=METHODS[key].marker, label=METHODS[key].title
        )
        for key in report.methods
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False)
