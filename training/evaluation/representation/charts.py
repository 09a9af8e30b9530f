"""The report's charts: PSNR by material, over time of encoding, and over a texture's history."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ..bench.charts import LOOKS, grid, legend, panels, save
from .damages import DAMAGE_TITLES
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

Panel = Callable[[Axes], None]


def _chart(
    report: Report, path: Path, panel_of: dict[str, Panel], columns: int, height: float, y: str
) -> bool:
    """Draw a chart of panels by title. Writes nothing and returns False where there are none."""
    if not panel_of:
        return False
    figure, axes = panels(len(panel_of), columns, (10, height), sharey=True)
    for i, (ax, (title, draw)) in enumerate(zip(axes, panel_of.items(), strict=True)):
        grid(ax, title)
        draw(ax)
        if i % columns == 0:
            ax.set_ylabel(y)
    legend(figure, report.methods)
    save(figure, path)
    return True


def chart_materials(report: Report, path: Path) -> bool:
    """The paper's figure 5: a dot a material and method, sorted by the first method, dotted means.
    Like all charts, not written (False) where there is nothing to draw.
    """
    shown = {}
    for name in _present(report, UNIFORM):
        found = {key: m.cells[name].materials for key, m in _having(report, name).items()}
        count = len(next(iter(found.values())))
        shown[f"{SET_TITLES[name]} ({count})"] = lambda ax, found=found: _materials(ax, found)
    return _chart(report, path, shown, 3, 2.9, "PSNR (dB)")


def _materials(ax: Axes, shown: dict[str, dict[str, float]]) -> None:
    first, scores = next(iter(shown.items()))
    order = sorted(scores, key=scores.__getitem__)
    few, x = len(order) <= 5, np.arange(1, len(order) + 1)
    good = np.array([material not in BAD_FITS for material in order])
    for key, scores in shown.items():
        look, values = LOOKS[key], np.array([scores[material] for material in order])
        size = 40 if few else 11
        style = {"s": size, "marker": look.marker, "linewidths": 0.8, "edgecolors": look.color}
        ax.scatter(x[good], values[good], c=look.color, **style)
        ax.scatter(x[~good], values[~good], facecolors="none", **style)
        ax.axhline(float(np.mean(values)), color=look.color, linestyle=":", linewidth=1.3)
    ax.grid(visible=False, axis="x")
    if few:
        ax.set_xticks(x, order, fontsize=7, rotation=12)
        ax.set_xlim(0.4, len(order) + 0.6)
    else:
        ax.set_xlabel(f"materials, sorted by {LOOKS[first].title}", fontsize=9)


def chart_speed(report: Report, path: Path) -> bool:
    """Time to encode a BRDF against accuracy, a curve a method; the larger marker is the method as
    the tables have it.
    """
    kinds: dict[str, Callable[[str], bool]] = {
        "analytic and real .bsdf": lambda name: name not in _MEASURED,
        "measured: MERL seen, held out, RGL": lambda name: name in _MEASURED,
    }
    shown = {}
    for title, wanted in kinds.items():
        points = {key: _points(m, wanted) for key, m in report.methods.items()}
        if any(points.values()):
            shown[title] = lambda ax, points=points: _speeds(ax, report, points)
    return _chart(report, path, shown, 2, 4.2, "mean PSNR (dB)")


Points = list[tuple[Point, float]]


def _points(method: MethodResult, wanted: Callable[[str], bool]) -> Points:
    """The curve's points and their means over all materials of the sets `wanted`."""
    found = []
    for point in method.curve:
        cells = [cell for name, cell in point.cells.items() if wanted(name)]
        values = [value for cell in cells for value in cell.materials.values()]
        if values:
            found.append((point, float(np.mean(values))))
    return found


def _speeds(ax: Axes, report: Report, points: dict[str, Points]) -> None:
    for key, some in points.items():
        _speed(ax, key, report.methods[key].cost.samples, some)
    ax.set_xscale("log")
    ax.margins(x=0.12, y=0.1)
    ax.set_xlabel("time to encode a BRDF on one core (ms)")


def _speed(ax: Axes, key: str, samples: int, points: Points) -> None:
    """A solid line over directions; for a method that trains, over iterations, and a dashed one
    over directions.
    """
    style: dict[str, Any] = {"color": LOOKS[key].color, "marker": LOOKS[key].marker}
    longest = max((point.iterations or 0 for point, _ in points), default=0)
    full = [(p, value) for p, value in points if (p.iterations or 0) == longest]
    trained = [(p, value) for p, value in points if longest and p.samples == samples]
    for line, dashes in ((trained, "-"), (full, "--" if longest else "-")):
        x, y = [p.encode_ms for p, _ in line], [value for _, value in line]
        ax.plot(x, y, linestyle=dashes, markersize=4, linewidth=1.4, **style)
    for i, (point, value) in enumerate(full):
        own, at = point.samples == samples, (point.encode_ms, value)
        if own:
            ax.plot(*at, markersize=10, markeredgecolor="black", **style)
        if own or i == 0:
            ax.annotate(
                f"m = {point.samples:,}", at, (0, 9 if own else -14),
                textcoords="offset points", ha="center", fontsize=8, color=style["color"],
            )  # fmt: skip


def chart_frames(report: Report, path: Path) -> bool:
    """The paper's figure 6: a score a frame of the two time-varying textures."""

    def frames(ax: Axes, name: str) -> None:
        for key, method in _having(report, name).items():
            scores = method.cells[name].materials
            times = [float(label.removeprefix("t = ")) for label in scores]
            _line(ax, key, times, list(scores.values()))
        ax.set_xlabel("time (share of the whole history)")

    shown = {
        SET_TITLES[name]: lambda ax, name=name: frames(ax, name)
        for name in _present(report, FRAMES)
    }
    return _chart(report, path, shown, 2, 2.9, "PSNR (dB)")


def chart_progress(report: Report, path: Path) -> bool:
    """PSNR of seen and unseen measured materials while the encoders were trained."""
    runs = {key: m.progress for key, m in report.methods.items() if m.progress}

    def progress(ax: Axes, name: str) -> None:
        for key, looks in runs.items():
            _line(ax, key, [look["minutes"] for look in looks], [look[name] for look in looks])
        ax.set_xlabel("minutes of one core")

    shown = {
        SET_TITLES[name]: lambda ax, name=name: progress(ax, name)
        for name in (_MEASURED if runs else ())
    }
    return _chart(report, path, shown, 3, 2.9, "PSNR of small spheres (dB)")


def chart_stability(report: Report, path: Path) -> bool:
    """Accuracy over damage to what an encoder reads, a panel a damage."""
    results = {key: m.properties["stability"] for key, m in report.methods.items() if m.properties}

    def damage(ax: Axes, name: str) -> None:
        for key, damages in results.items():
            curve = damages[name]
            known = [(x, y) for x, y in enumerate(curve["mean"]) if y is not None]
            _line(ax, key, *zip(*known, strict=True))
            ax.set_xticks(range(len(curve["labels"])), curve["labels"], fontsize=7, rotation=20)

    titles = DAMAGE_TITLES if results else {}
    shown = {title: lambda ax, name=name: damage(ax, name) for name, title in titles.items()}
    return _chart(report, path, shown, 3, 2.8, "PSNR (dB)")


def _line(ax: Axes, key: str, x: Sequence[float], y: Sequence[float]) -> None:
    ax.plot(x, y, color=LOOKS[key].color, marker=LOOKS[key].marker, markersize=4)


def _having(report: Report, name: str) -> dict[str, MethodResult]:
    """The methods that have a score on the set `name`."""
    return {key: method for key, method in report.methods.items() if name in method.cells}


def _present(report: Report, names: Sequence[str]) -> list[str]:
    """Those of the sets `names` that any method has a score on."""
    return [name for name in names if _having(report, name)]
