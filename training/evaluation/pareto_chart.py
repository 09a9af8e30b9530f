"""The chart: accuracy over seconds, a panel each for whole commands, latents and the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .pareto_results import ParetoReport, Point

__all__ = ("draw_chart",)

_COLORS = {
    "": "#111111",
    "palette": "#0072b2",
    "rung": "#d55e00",
    "frames": "#009e73",
    "size": "#cc79a7",
    "compression": "#e69f00",
    "samples": "#56b4e9",
    "fit": "#8c564b",
    "precision": "#999999",
    "rival": "#b22222",
}
_TITLES = {"": "quality", "samples": "samples m", "rung": "temporal rung", "rival": "other methods"}


def draw_chart(report: ParetoReport, path: Path) -> None:
    """Write the chart to `path` (PNG)."""
    size, frames = report.settings["size"], report.settings["frames"]
    figure = Figure(figsize=(11, 12), layout="constrained")
    axes = figure.subplots(3, 1)
    panels = {
        "whole": f"The whole command, {size} x {size}, {frames} frames",
        "latents": f"With the LSTM on latents, {size // report.settings['quarter']} pixels wide,"
        f" {frames} frames",
    }
    for ax, (panel, title) in zip(axes, panels.items(), strict=False):
        shown = [point for point in report.points if point.panel == panel]
        _draw(ax, shown, lambda p: p.core, lambda p: p.mean, lambda p: p.front, _extrapolated)
        ax.set_title(title, fontsize=11)
        ax.set_ylabel("PSNR against exact (dB)")
        ax.set_xlabel("core seconds a material")
    known = [point for point in report.points if point.truth is not None]
    _draw(
        axes[2],
        known,
        lambda p: p.truth.seconds if p.truth else 0.0,
        lambda p: p.truth_mean,
        lambda p: p.truth_front,
        lambda p: p.truth is not None and p.truth.extrapolated,
    )
    pixels = report.settings["pixels"]
    axes[2].set_title(f"Known histories (S1, S2, S3), {pixels} x {pixels} texels", fontsize=11)
    axes[2].set_ylabel("PSNR against the truth (dB)")
    axes[2].set_xlabel("core seconds to model 36 frames, without reading and writing")
    knobs = list(dict.fromkeys(point.knob for point in report.points))
    handles = [_dot(_TITLES.get(knob, knob), color=_COLORS[knob]) for knob in knobs]
    handles += [_dot("extrapolated", color="black", markerfacecolor="none")]
    handles += [Line2D([], [], color="#888888", linewidth=1.2, label="Pareto front")]
    figure.legend(handles=handles, loc="outside upper center", ncols=6, frameon=False)
    figure.savefig(path, dpi=100)


def _draw(
    ax: Axes,
    points: Sequence[Point],
    cost: Callable[[Point], float],
    gain: Callable[[Point], float | None],
    front: Callable[[Point], bool],
    extrapolated: Callable[[Point], bool],
) -> None:
    placed = sorted((cost(p), gain(p) or 0.0, p.name, p) for p in points)
    line = [(x, y) for x, y, _, p in placed if front(p)]
    if line:
        ax.step(*zip(*line, strict=True), where="post", color="#888888", linewidth=1.2, zorder=1)
    for x, y, _, point in placed:
        color = _COLORS[point.knob]
        default = point.knob == ""
        ax.plot(
            x,
            y,
            marker="s" if default else "o",
            markersize=9 if default else 6,
            color=color,
            markerfacecolor="none" if extrapolated(point) else color,
            zorder=3 if default else 2,
        )
    ax.set_xscale("log")
    ax.margins(x=0.12, y=0.12)
    ax.grid(color="#dddddd", linewidth=0.6)
    _label(ax, placed)


def _label(ax: Axes, placed: Sequence[tuple[float, float, str, Point]]) -> None:
    """Names beside the points, pushed up or down until no two overlap."""
    figure = ax.figure
    figure.draw_without_rendering()
    taken: list[tuple[float, float, float, float]] = []
    for x, y, name, point in placed:
        across, up = ax.transData.transform((x, y))
        width, height = 5.6 * len(name), 12.0
        for shift in sorted(range(-180, 181, 6), key=abs):
            for left in (across + 8, across - 8 - width):
                box = (left, up + shift - height / 2, left + width, up + shift + height / 2)
                if not any(_overlap(box, other) for other in taken) and _inside(ax, box):
                    break
            else:
                continue
            break
        taken.append(box)
        ax.annotate(
            name,
            (x, y),
            xytext=(box[0], up + shift),
            textcoords="figure pixels",
            fontsize=8,
            va="center",
            color=_COLORS[point.knob],
            arrowprops={"arrowstyle": "-", "color": "#bbbbbb", "linewidth": 0.6}
            if abs(shift) > 12
            else None,
        )


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _inside(ax: Axes, box: tuple[float, ...]) -> bool:
    area = ax.get_window_extent()
    return box[0] > area.x0 and box[2] < area.x1 and box[1] > area.y0 and box[3] < area.y1


def _extrapolated(point: Point) -> bool:
    return point.extrapolated


def _dot(label: str, **style: str) -> Line2D:
    return Line2D([], [], linestyle="none", marker="o", label=label, **style)
