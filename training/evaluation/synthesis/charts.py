"""The report's pictures: PSNR over time, over minutes and of domains; strips with errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from ..bench.charts import LOOKS, Shown, compared, grid, panels, save
from .cases import Case
from .domains import DomainResult
from .results import CaseResult, SynthesisReport
from .scoring import Scored, Scorer, strip_frames

__all__ = (
    "SHOWCASES",
    "Strip",
    "chart_curves",
    "chart_domains",
    "chart_minutes",
    "chart_statistics",
    "draw_strip",
)

SHOWCASES = (
    "s1_a0.8_b0.1",
    "s2_a0.8_b0.2",
    "s3",
    "s4",
    "real_tvbtf45",
    "real_snowyground",
    "real_steelrusting",
)
"""Cases with a curve of their own and a strip; of several materials the first is shown."""

_STRIDE = 3
_ERROR_SCALE = 0.15


@dataclass(frozen=True)
class Strip:
    """Tone-mapped pixels [t, p, 3] of the truth and of every method in five frames of one case, and
    the methods' PSNR over all maps.
    """

    case: Case
    frames: tuple[int, ...]
    inside: Tensor
    truth: Tensor
    methods: Mapping[str, Tensor]
    scores: Mapping[str, Scored]

    @classmethod
    def of(cls, scorer: Scorer, found: Mapping[str, Scored]) -> Strip:
        """Of the methods `found`."""
        inside = scorer.stage.sphere.sphere.inside[::_STRIDE, ::_STRIDE]
        length = len(scorer.case.target.times)
        methods = {name: scorer.strip(name, _STRIDE) for name in found}
        truth = scorer.strip(None, _STRIDE)
        return cls(scorer.case, tuple(strip_frames(length)), inside, truth, methods, found)

    def score(self, name: str, frame: int) -> str:
        """PSNR in a frame, from the curve; the first one is given."""
        every = self.scores[name].curves["score"].every
        return f"{every[frame - 1]:.1f} dB" if frame > 0 else "given"


def draw_strip(strip: Strip, path: Path) -> None:
    """Columns are frames; rows the truth, then each method above its error."""
    columns = [
        (
            f"frame {frame + 1}",
            strip.truth[i],
            {n: Shown(pixels[i], strip.score(n, frame)) for n, pixels in strip.methods.items()},
        )
        for i, frame in enumerate(strip.frames)
    ]
    figure, _ = compared(columns, tuple(strip.methods), strip.inside, _ERROR_SCALE)
    save(figure, path)


def chart_curves(report: SynthesisReport, path: Path) -> bool:
    """The paper's figure 8: PSNR over time, a panel a case; ceilings dotted. Like all charts, not
    written (False) where there is nothing to draw.
    """
    shown = [name for name in SHOWCASES if name in report.cases]
    if not shown:
        return False
    figure, axes = panels(len(shown), 2, (10, 3.2))
    for ax, name in zip(axes, shown, strict=True):
        grid(ax, name, "frame (1 is given)", "PSNR (dB)")
        _curves(ax, report.cases[name])
    handles, labels = max((ax.get_legend_handles_labels() for ax in axes), key=lambda x: len(x[1]))
    figure.legend(handles, labels, loc="outside upper center", ncols=5, frameon=False)
    save(figure, path)
    return True


def _curves(ax: Axes, case: CaseResult) -> None:
    for name, curve in case.curves.items():
        look, width = LOOKS[name], 2.6 if name == "ours" else 1.3
        x = np.array(curve.frames) + 1
        ax.plot(x, curve.psnr, label=look.title, color=look.color, linewidth=width)
        if name in case.ceilings:
            ceiling = case.ceilings[name]
            ax.plot(np.array(ceiling.frames) + 1, ceiling.psnr, ":", color=look.color)


def chart_statistics(report: SynthesisReport, path: Path) -> bool:
    """Distances of histograms and autocorrelations over time."""
    shown = {name: case.statistics for name, case in report.cases.items() if case.statistics}
    if not shown:
        return False
    figure, axes = panels(2 * len(shown), 2, (10, 2.8))
    for i, ax in enumerate(axes):
        (case, statistics), column = list(shown.items())[i // 2], i % 2
        title = ("histogram", "autocorrelation")[column]
        grid(ax, f"{case}: {title} distance", "frame")
        for variant, found in statistics.items():
            frames = found["frames"]
            distances = [pair[column] for pair in frames.values()]
            ax.plot([frame + 1 for frame in frames], distances, label=variant)
    axes[0].legend(fontsize=8)
    save(figure, path)
    return True


def chart_minutes(report: SynthesisReport, path: Path) -> bool:
    """PSNR over minutes of training, a panel a case."""
    if not report.learning:
        return False
    figure, axes = panels(len(report.learning), 2, (9, 2.9))
    for ax, (case, methods) in zip(axes, report.learning.items(), strict=True):
        grid(ax, case, "minutes of one core, all rungs", "mean PSNR (dB)")
        for method, points in methods.items():
            look = LOOKS[method]
            ax.plot(*zip(*points, strict=True), "o-", color=look.color, label=look.title)
    axes[0].legend(fontsize=8)
    save(figure, path)
    return True


def chart_domains(results: Mapping[str, DomainResult], path: Path) -> bool:
    """One ROC curve an NTM, and where on it the product decides."""
    if not results:
        return False
    figure = Figure(figsize=(6, 5), layout="constrained")
    ax = figure.subplots()
    grid(ax, "", "share of fitting texels taken for foreign", "share of foreign texels noticed")
    for name, result in results.items():
        label = f"{name} {result.auroc:.3f}"
        (line,) = ax.plot(result.false_alarms, result.caught, label=label, linewidth=1.5)
        near, far = (
            np.mean([s for n, s in result.outside.items() if (n in result.fitting) == fits])
            for fits in (True, False)
        )
        ax.plot(near, far, "o", color=line.get_color())
    ax.set_xlim(-0.01, 0.5)
    ax.set_ylim(0.5, 1.01)
    ax.legend(title="AUROC; dots: the product", loc="lower right")
    save(figure, path)
    return True
