"""The chart: accuracy over seconds, a panel each for whole commands, latents and the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from .results import ParetoReport, Point
from .settings import LATENTS

__all__ = ("draw_chart",)

_COLORS = {
    "": "#111111",
    "binding": "#e69f00",
    "palette": "#0072b2",
    "rung": "#d55e00",
    "frames": "#009e73",
    "size": "#cc79a7",
    "compression": "#b8860b",
    "samples": "#1b9ad6",
    "fit": "#8c564b",
    "rival": "#b22222",
}
_TITLES = {"": "quality", "samples": "samples m", "rung": "temporal rung", "rival": "rival"}
_LETTER = 5.3  # width in pixels, of labels
_LINE = 13


@dataclass(frozen=True)
class _Mark:
    """A point in one panel: seconds, dB, its name and knob, whether it lies on the front, and
    whether its seconds are extrapolated.
    """

    seconds: float
    psnr: float
    name: str
    knob: str
    front: bool
    extrapolated: bool


def draw_chart(report: ParetoReport, path: Path) -> None:
    """Write the chart to `path` (PNG)."""
    size, frames, pixels = (report.settings[name] for name in ("size", "frames", "pixels"))
    quarter = size // report.settings["quarter"]
    figure = Figure(figsize=(11, 13), dpi=100, layout="constrained")
    axes = figure.subplots(3, 1)
    panels = (
        (f"The whole command, {size} x {size}, {frames} frames", _against_exact(report, "whole")),
        (
            f"The whole command with the LSTM on latents, {quarter} x {quarter}, {frames} frames",
            _against_exact(report, "latents"),
        ),
        (f"Known histories: S1, S2, S3; {pixels} x {pixels} texels", _against_truth(report)),
    )
    for ax, (title, marks) in zip(axes, panels, strict=True):
        _draw(ax, marks)
        ax.set_title(title, fontsize=11)
        ax.set_ylabel("PSNR against exact (dB)")
        ax.set_xlabel("core seconds a material")
    axes[2].set_ylabel("PSNR against the truth (dB)")
    axes[2].set_xlabel("core seconds a case, modeling alone")
    knobs = dict.fromkeys(point.knob for point in report.points)
    handles = [
        Line2D([], [], linestyle="none", marker="o", color=_COLORS[k], label=_TITLES.get(k, k))
        for k in knobs
    ]
    handles += [
        Line2D([], [], linestyle="none", marker="o", color="k", mfc="none", label="extrapolated"),
        Line2D([], [], color="#888888", linewidth=1.2, label="Pareto front"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=6, frameon=False)
    figure.draw_without_rendering()  # places the axes, among which labels find room
    for ax, (_, marks) in zip(axes, panels, strict=True):
        _label(ax, marks)
    figure.savefig(path)


def _against_exact(report: ParetoReport, panel: str) -> list[_Mark]:
    return [
        _Mark(p.core, p.mean, p.name, p.knob, p.front, p.extrapolated)
        for p in report.points
        if p.panel == panel and p.mean is not None
    ]


def _against_truth(report: ParetoReport) -> list[_Mark]:
    def mark(p: Point) -> _Mark | None:
        if p.truth is None or p.truth_mean is None:
            return None
        seconds, extrapolated = p.truth.seconds, p.truth.extrapolated
        return _Mark(seconds, p.truth_mean, p.name, p.knob, p.truth_front, extrapolated)

    return [found for found in map(mark, report.points) if found is not None]


def _draw(ax: Axes, marks: Sequence[_Mark]) -> None:
    line = sorted((mark.seconds, mark.psnr) for mark in marks if mark.front)
    ax.step(*zip(*line, strict=True), where="post", color="#888888", linewidth=1.2, zorder=1)
    for mark in marks:
        color, quality = _COLORS[mark.knob], mark.knob == ""
        ax.plot(
            mark.seconds,
            mark.psnr,
            marker="s" if quality else "o",
            markersize=9 if quality else 6,
            color=color,
            markerfacecolor="white" if mark.extrapolated else color,
            zorder=3 if quality else 2,
        )
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter(FuncFormatter(_plain))
    ax.xaxis.set_minor_formatter(FuncFormatter(_few))
    ax.tick_params(axis="x", which="minor", labelsize=7)
    ax.margins(x=0.1, y=0.12)
    ax.grid(color="#e4e4e4", linewidth=0.6)


def _label(ax: Axes, marks: Sequence[_Mark]) -> None:
    """Names beside the points, as near as they find room; what all have in common is left out."""
    short = all(mark.name.startswith(LATENTS) for mark in marks)
    area = ax.get_window_extent()
    at = {mark.name: ax.transData.transform((mark.seconds, mark.psnr)) for mark in marks}
    taken = [(x - 6, y - 6, x + 6, y + 6) for x, y in at.values()]
    for mark in sorted(marks, key=lambda mark: mark.knob != ""):
        x, y = at[mark.name]
        name = mark.name.removeprefix(f"{LATENTS}, ") if short else mark.name
        width = _LETTER * len(name)
        boxes = [
            (left, y + shift - _LINE / 2, left + width, y + shift + _LINE / 2)
            for shift in sorted(range(-220, 221, 4), key=abs)
            for left in (x + 10, x - 10 - width, x - width / 2)
        ]
        box = next(
            (box for box in boxes if _within(box, area.extents) and not _hit(box, taken)), boxes[0]
        )
        taken.append(box)
        far = abs((box[1] + box[3]) / 2 - y) > _LINE
        text = ax.annotate(
            name,
            (mark.seconds, mark.psnr),
            xytext=((box[0] + box[2]) / 2, (box[1] + box[3]) / 2),
            textcoords="figure pixels",
            fontsize=8,
            ha="center",
            va="center",
            color=_COLORS[mark.knob],
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.3},
            zorder=1.5,
            arrowprops={"arrowstyle": "-", "color": "#bbbbbb", "linewidth": 0.7} if far else None,
        )
        text.set_in_layout(False)


def _plain(seconds: float, _: object) -> str:
    return f"{seconds:g}"


def _few(seconds: float, _: object) -> str:
    """Of the ticks between powers of ten, those of 2 and 5."""
    return f"{seconds:g}" if f"{seconds:e}"[0] in "25" else ""


def _hit(box: Sequence[float], taken: Sequence[Sequence[float]]) -> bool:
    return any(box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in taken)


def _within(box: Sequence[float], area: Sequence[float]) -> bool:
    return area[0] < box[0] and box[2] < area[2] and area[1] < box[1] and box[3] < area[3]
