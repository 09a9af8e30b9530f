"""The report's pictures: speed against realism, contact sheets, profiles and curves."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image, ImageDraw

from ..bench.charts import LOOKS, Look, grid, panels, save
from .comparing import Picture
from .results import RealismReport
from .spots import STATISTICS

__all__ = ("draw_chart", "draw_relief", "draw_sheet", "draw_spots", "draw_strip")

_LOOKS: Mapping[str, Look] = {
    "ours": LOOKS["ours"],
    "ours_v1": Look("ours, formulas", "#56B4E9"),
    "crossfade": Look("cross-fade", "#999999"),
    "stt": LOOKS["stt"],
    "paper": LOOKS["paper"],
    "ode": Look("from noise", "#CC79A7"),
    "same_scan": Look("same scan", "#000000", "_"),
    "other_scan": Look("another scan", "#8B5A2B", "_"),
}
_SIDE = 256  # pixels of a picture on a sheet
_GAP, _LINE = 6, 18
_INK, _PAPER = (20, 20, 20), (250, 250, 250)


def draw_chart(report: RealismReport, folder: Path) -> Path:
    """Mean distance over targets by seconds, a point a method; what is real, as lines."""
    figure = Figure(figsize=(7, 4.6), layout="constrained")
    ax = figure.subplots()
    grid(ax, "", "seconds of a core to age a material", "distance, mean over targets (0: the same)")
    distances, seconds = defaultdict(list), defaultdict(list)
    for target in report.targets.values():
        for name, found in target.methods.items():
            distances[name].append(found.distance)
            if found.seconds is not None:
                seconds[name].append(found.seconds)
    for name, values in distances.items():
        look, mean = _LOOKS[name], float(np.mean(values))
        if name in seconds:
            x = float(np.mean(seconds[name]))
            ax.plot(x, mean, look.marker, color=look.color, markersize=10)
            ax.annotate(look.title, (x, mean), (8, 4), textcoords="offset points", fontsize=9)
        else:
            ax.axhline(mean, color=look.color, linewidth=1, linestyle="--")
            ax.annotate(
                look.title, (1, mean), (-4, 3), xycoords=("axes fraction", "data"),
                textcoords="offset points", ha="right", fontsize=9, color=look.color,
            )  # fmt: skip
    ax.set_xscale("log")
    ax.margins(x=0.25)
    ax.set_ylim(bottom=0)
    path = folder / "realism.png"
    save(figure, path)
    return path


def draw_sheet(name: str, rows: Mapping[str, Mapping[str, Picture]], folder: Path) -> Path:
    """Rows of pictures with their titles, each a square of 256 texels, texel by texel."""
    columns = max(len(row) for row in rows.values())
    width = columns * (_SIDE + _GAP) + _GAP
    sheet = Image.new("RGB", (width, len(rows) * (_SIDE + _LINE + _GAP) + _GAP), _PAPER)
    pen = ImageDraw.Draw(sheet)
    for i, (title, row) in enumerate(rows.items()):
        top = _GAP + i * (_SIDE + _LINE + _GAP)
        for j, (method, picture) in enumerate(row.items()):
            left = _GAP + j * (_SIDE + _GAP)
            text = _LOOKS[method].title if method in _LOOKS else method
            pen.text((left, top), f"{text}, {title}" if j == 0 else text, _INK)
            pixels = picture.pixels[:_SIDE, :_SIDE]
            shown = Image.fromarray(np.rint(255 * pixels.clip(0, 1)).astype(np.uint8))
            sheet.paste(shown, (left, top + _LINE))
    path = folder / f"sheet_{name}.png"
    sheet.save(path)
    return path


def draw_relief(relief: Mapping[str, Any], folder: Path) -> Path:
    """Height by distance from the border."""
    figure = Figure(figsize=(7, 4), layout="constrained")
    ax = figure.subplots()
    grid(ax, "", "texels from the border (clean below 0)", "height, in drops")
    for key, profile, color in (
        ("right half", relief["truth"], "#000000"),
        ("left half, learned from", relief["own_half"]["profile"], "#999999"),
        ("ours", relief.get("ours"), LOOKS["ours"].color),
    ):
        if profile is not None:
            ax.plot(relief["distance"], profile.height, "o-", color=color, label=key)
    ax.legend()
    path = folder / "relief.png"
    save(figure, path)
    return path


def draw_spots(spots: Mapping[str, Any], folder: Path) -> Path:
    """Number, area and perimeter over time, a row a sequence."""
    figure, axes = panels(3 * len(spots), 3, (10, 2.8))
    colors = {"met": "#000000", "learned": "#999999"}
    for i, (name, found) in enumerate(spots.items()):
        for j, statistic in enumerate(STATISTICS):
            ax = axes[3 * i + j]
            grid(ax, f"{name}: {statistic}", "time")
            for side, curves in found["curves"].items():
                time = np.linspace(0, 1, len(curves[j]))
                ax.plot(time, curves[j], color=colors.get(side) or _LOOKS[side].color, label=side)
    axes[-1].legend(fontsize=8)
    path = folder / "spots.png"
    save(figure, path)
    return path


def draw_strip(rows: Mapping[str, Mapping[str, Picture]], folder: Path) -> Path:
    """Age to the right, the truth and each method that continues it below each other."""
    methods = [name for name in ("truth", "ours", "ode") if name in next(iter(rows.values()))]
    strip = [np.concatenate([shown[name].pixels for shown in rows.values()], 1) for name in methods]
    pixels = np.rint(255 * np.concatenate(strip).clip(0, 1)).astype(np.uint8)
    path = folder / "rival.jpg"
    Image.fromarray(pixels).save(path, quality=80)
    return path
