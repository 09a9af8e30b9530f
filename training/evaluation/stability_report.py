"""The report `stability` for readers: `stability.md` and its chart."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .stability_results import FAILS_BELOW, MethodResult, StabilityReport
from .stability_trials import Stress
from .synthesis_charts import COLORS, TITLES

__all__ = ("stability_table", "write_report")

_COLUMNS = 5
_TOP = 75.0


def write_report(report: StabilityReport, stresses: Mapping[str, Stress], folder: Path) -> None:
    """Write `stability.md` and `stability.png` to `folder`."""
    draw_chart(report, stresses, folder / "stability.png")
    table = stability_table(report, stresses)
    parts = ["# Where methods fail", table, "![Stability](stability.png)"]
    (folder / "stability.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def stability_table(report: StabilityReport, stresses: Mapping[str, Stress]) -> str:
    """A row a stress: where each method fails, and where the product says that something is
    wrong.
    """
    methods = [name for name in TITLES if any(name in found for found in report.stresses.values())]
    lines = ["| fails at | " + " | ".join(TITLES[name] for name in methods) + " | product says |"]
    lines.append("|---" * (len(methods) + 2) + "|")
    for name, found in report.stresses.items():
        stress = stresses[name]
        points = [_point(stress, found[m]) if m in found else "" for m in methods]
        texts = [f"{stress.title}: {stress.axis}", *points, _said(stress, found)]
        lines.append("| " + " | ".join(texts) + " |")
    return "\n".join(lines)


def _point(stress: Stress, found: MethodResult) -> str:
    x = found.fails_at
    if x is None:
        return "never"
    return "from the first" if x == stress.severities[0] else _label(stress, x)


def _said(stress: Stress, found: Mapping[str, MethodResult]) -> str:
    if "ours" not in found:
        return ""
    ours = found["ours"]
    from_ = ours.noticed_from
    if from_ is None:
        return "nothing" if ours.fails_at is None else "**nothing**"
    text = f"from {_label(stress, from_)}"
    return text if ours.noticed is not False else f"**{text}, not always**"


def _label(stress: Stress, x: float) -> str:
    return stress.labels.get(x, f"{x:g}")


def draw_chart(report: StabilityReport, stresses: Mapping[str, Stress], path: Path) -> None:
    """A panel a stress: PSNR by severity, a line a method, harmless left and absurd right."""
    names = list(report.stresses)
    columns = min(_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(3.1 * columns, 2.35 * rows + 0.7), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for ax, name in zip(axes, names, strict=False):
        _panel(ax, stresses[name], report.stresses[name])
    for ax in axes[len(names) :]:
        ax.set_visible(False)
    for ax in axes[::columns]:
        ax.set_ylabel("PSNR (dB)", fontsize=8)
    seen: dict[str, object] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            seen.setdefault(label, handle)
    style = {"loc": "outside upper center", "ncols": 5, "frameon": False, "fontsize": 9}
    figure.legend(list(seen.values()), list(seen), **style)
    figure.savefig(path, dpi=100)


def _panel(ax: Axes, stress: Stress, methods: Mapping[str, MethodResult]) -> None:
    place = {x: i for i, x in enumerate(stress.severities)}
    for name, found in methods.items():
        x = [place[severity] for severity in found.outcomes]
        y = np.array([min(outcome.psnr, _TOP) for outcome in found.outcomes.values()])
        ours = name == "ours"
        ax.plot(
            x, y, "o-", color=COLORS[name], label=TITLES[name], markersize=3.5 if ours else 2,
            linewidth=2.4 if ours else 1.1, zorder=3 if ours else 2,
        )  # fmt: skip
        if ours and found.noticed_from is not None:
            said = (place[found.noticed_from], len(place) - 0.8)
            ax.axvspan(
                *said, color=COLORS[name], alpha=0.1, linewidth=0, label="the product says so"
            )
    ax.axhline(FAILS_BELOW, color="#888888", linewidth=0.9, linestyle="--", label="25 dB: failed")
    ax.set_ylim(0, _TOP + 3)
    ax.set_xlim(-0.2, len(place) - 0.8)
    ax.set_xticks(range(len(place)), [_label(stress, x) for x in place], fontsize=7)
    ax.tick_params(axis="y", labelsize=7)
    ax.set_title(stress.title, fontsize=9)
    ax.set_xlabel(stress.axis, fontsize=7.5, labelpad=1)
    ax.grid(color="#e4e4e4", linewidth=0.5)
