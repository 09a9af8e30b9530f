"""The report `stability` for readers: `stability.md`, its table and its chart."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..bench.charts import LOOKS, grid, panels
from ..bench.results import image, table
from .results import FAILS_BELOW, MethodResult, StabilityReport
from .trials import Stress

__all__ = ("draw_chart", "page", "stability_table")

_COLUMNS = 4
_TOP = 70.0
_NOTHING = 2.0
_OURS = "ours"


def page(report: StabilityReport, stresses: Mapping[str, Stress]) -> list[str]:
    """The paragraphs of `stability.md`."""
    noted = [stresses[name] for name in report.stresses if stresses[name].note]
    return [
        "# Where methods fail",
        _explanation(report),
        stability_table(report, stresses),
        "## Where others bear more than ours",
        _behind(report, stresses),
        "## What the stresses leave out",
        "\n".join(f"- {stress.title}: {stress.note}." for stress in noted),
        "## Curves",
        image("stability.png", "PSNR by severity"),
    ]


def _explanation(report: StabilityReport) -> str:
    pixels, stride = report.settings["pixels"], report.settings["stride"]
    return f"""The first severity, from harmless to absurd, at which a method fails: less than \
{FAILS_BELOW:g} dB, nothing finite, nothing at all, or more than 1 % of the texels out of gamut \
(Kd or Ks below 0, alpha beyond 1e-4 to 1, or three times too bright) where the truth is not.

- PSNR of tone-mapped spheres, {pixels} pixels wide, averaged over three environment maps and four \
frames, as in `evaluate synthesis`. `paper` and `LSTM, latents` are scored on every {stride}th row \
and column.
- Unless a stress says otherwise, methods learn how one patch of painted wood fades, and continue \
the first frame of another. Nobody is exact there, and everybody holds before it is disturbed.
- *Ours* is the real `age` on files, with its palette and its choice of a rung; the other rungs \
model every texel for itself. *Product says*: from which severity it warns or refuses. In bold: it \
does not say so everywhere that it fails.
"""


def stability_table(report: StabilityReport, stresses: Mapping[str, Stress]) -> str:
    """A row a stress: where each method fails, and where the product says that something is
    wrong.
    """
    methods, rows = _shown(report), []
    for name, found in report.stresses.items():
        stress = stresses[name]
        points = [_point(stress, found[m]) if m in found else "" for m in methods]
        rows.append([f"{stress.title}: {stress.axis}", *points, _said(stress, found)])
    return table(["fails at", *(LOOKS[name].title for name in methods), "product says"], rows)


def _shown(report: StabilityReport) -> list[str]:
    """The methods of the report, in the order of all tables."""
    return [name for name in LOOKS if any(name in found for found in report.stresses.values())]


def _point(stress: Stress, found: MethodResult) -> str:
    x = found.fails_at
    if x is None:
        return "never"
    return "from the first" if x == stress.severities[0] else _label(stress, x)


def _said(stress: Stress, found: Mapping[str, MethodResult]) -> str:
    if _OURS not in found:
        return ""
    ours = found[_OURS]
    if ours.noticed_from is None:
        return "nothing" if ours.fails_at is None else "**nothing**"
    text = f"from {_label(stress, ours.noticed_from)}"
    return text if ours.noticed is not False else f"**{text}, not always**"


def _behind(report: StabilityReport, stresses: Mapping[str, Stress]) -> str:
    lines = []
    for name in report.stresses:
        ahead = [
            f"{LOOKS[method].title} holds to {_label(stresses[name], x)}"
            for method, x in report.behind(name).items()
            if x is not None
        ]
        if ahead:
            lines.append(f"- {stresses[name].title}: {', '.join(ahead)}.")
    return "\n".join(lines) or "Nowhere."


def _label(stress: Stress, x: float) -> str:
    return stress.labels.get(x, f"{x:g}")


def draw_chart(report: StabilityReport, stresses: Mapping[str, Stress], path: Path) -> None:
    """A panel a stress: PSNR by severity, a line a method, harmless left and absurd right."""
    names = list(report.stresses)
    figure, axes = panels(len(names), _COLUMNS, (3.0 * min(_COLUMNS, len(names)), 2.2))
    for i, (ax, name) in enumerate(zip(axes, names, strict=True)):
        grid(ax, "", stresses[name].axis, "" if i % _COLUMNS else "PSNR (dB)")
        _panel(ax, stresses[name], report.stresses[name])
    figure.legend(handles=_legend(report), loc="outside upper center", ncols=4, frameon=False)
    figure.savefig(path, dpi=80)


def _panel(ax: Axes, stress: Stress, methods: Mapping[str, MethodResult]) -> None:
    place = {x: i for i, x in enumerate(stress.severities)}
    for name, found in sorted(methods.items(), key=lambda item: item[0] == _OURS):
        color, thick = LOOKS[name].color, 2.6 if name == _OURS else 1.2
        x = np.array([place[severity] for severity in found.outcomes])
        y = np.array([min(outcome.psnr, _TOP) for outcome in found.outcomes.values()])
        fits = np.array([outcome.in_gamut for outcome in found.outcomes.values()])
        ax.plot(x, y, "-", color=color, linewidth=thick)
        for some, face in ((fits, color), (~fits, "white")):
            ax.plot(x[some], y[some], "o", color=color, mfc=face, ms=1.6 * thick + 1.4)
        none = np.isnan(y)
        ax.plot(x[none], np.full(none.sum(), _NOTHING), "x", color=color, ms=4.5 + thick)
        if found.noticed_from is not None:
            said = (place[found.noticed_from] - 0.15, len(place) - 0.8)
            ax.axvspan(*said, color=color, alpha=0.12, linewidth=0)
    ax.axhline(FAILS_BELOW, color="#777777", linewidth=0.9, linestyle="--")
    ax.set_ylim(0, _TOP + 3)
    ax.set_xlim(-0.2, len(place) - 0.8)
    ax.set_xticks(range(len(place)), [_label(stress, x) for x in place], fontsize=7)
    ax.tick_params(axis="y", labelsize=7)
    ax.set_title(stress.title, fontsize=9)


def _legend(report: StabilityReport) -> list[Line2D | Patch]:
    lines = [
        Line2D([], [], color=LOOKS[name].color, marker="o", label=LOOKS[name].title)
        for name in _shown(report)
    ]
    gray = "#777777"
    return [
        *lines,
        Line2D([], [], color=gray, marker="o", mfc="white", linestyle="", label="out of gamut"),
        Line2D([], [], color=gray, marker="x", linestyle="", label="nothing came out"),
        Line2D([], [], color=gray, linestyle="--", label=f"{FAILS_BELOW:g} dB: failed below"),
        Patch(color=LOOKS[_OURS].color, alpha=0.15, label="the product warns or refuses"),
    ]
