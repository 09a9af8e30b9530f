"""The report's pictures: PSNR over time, statistics over time, and rendered strips with errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from torch import Tensor

from model_runtime.contract import AFFINE, CONSTANT, LSTM_LATENTS, LSTM_PARAMETERS

from .cases import Case
from .results import CaseResult, SynthesisReport
from .scoring import Scored, Scorer, strip_frames

__all__ = (
    "COLORS",
    "SHOWCASES",
    "TITLES",
    "Strip",
    "chart_curves",
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

TITLES = {
    "ours": "ours",
    "paper": "paper",
    "brdfnps": "BRDFNPs",
    "stt": "STT",
    "staf": "STAF",
    CONSTANT: "constant",
    AFFINE: "affine",
    LSTM_PARAMETERS: "LSTM, parameters",
    LSTM_LATENTS: "LSTM, latents",
}
COLORS = {
    "ours": "#0072B2",
    "paper": "#D55E00",
    "brdfnps": "#E69F00",
    "stt": "#009E73",
    "staf": "#CC79A7",
    CONSTANT: "#999999",
    AFFINE: "#000000",
    LSTM_PARAMETERS: "#56B4E9",
    LSTM_LATENTS: "#8B5A2B",
}
_STRIDE = 3
_CELL = 1.1
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

    def score(self, name: str, frame: int) -> float | None:
        """PSNR in a frame, from the curve; None for the given one."""
        every = self.scores[name].curves["score"].every
        return float(every[frame - 1]) if frame > 0 else None


def draw_strip(strip: Strip, path: Path) -> None:
    """Columns are frames; rows the truth, then each method above its error."""
    rows, columns = 1 + 2 * len(strip.methods), len(strip.frames)
    figure = Figure(figsize=(_CELL * columns + 1.3, _CELL * rows + 0.5))
    grid = figure.subplots(
        rows,
        columns,
        gridspec_kw={
            "left": 1.3 / (_CELL * columns + 1.3),
            "right": 0.99,
            "top": 1 - 0.35 / (_CELL * rows + 0.5),
            "bottom": 0.15 / (_CELL * rows + 0.5),
            "wspace": 0.05,
            "hspace": 0.18,
        },
    )
    for column, frame in enumerate(strip.frames):
        grid[0, column].set_title(f"frame {frame + 1}", fontsize=9)
        _show(grid[0, column], strip.truth[column], strip.inside)
        for i, (name, pixels) in enumerate(strip.methods.items()):
            above, below = grid[1 + 2 * i : 3 + 2 * i, column]
            _show(above, pixels[column], strip.inside)
            error = (pixels[column].float() - strip.truth[column].float()).abs().mean(-1)
            _show(below, error, strip.inside)
            score = strip.score(name, frame)
            below.set_xlabel(
                "given" if score is None else f"{score:.1f} dB", fontsize=7, labelpad=1
            )
    titles = ["truth"]
    for name in strip.methods:
        titles += [TITLES[name], "error"]
    for ax, title in zip(grid[:, 0], titles, strict=True):
        ax.set_ylabel(title, rotation=0, ha="right", va="center", fontsize=9)
    figure.savefig(path, dpi=100)


def _show(ax: Axes, values: Tensor, inside: Tensor) -> None:
    """Pixels [p, 3] in colour, errors [p] on the scale that all strips share."""
    ax.set_xticks([])
    ax.set_yticks([])
    for side in ax.spines.values():
        side.set_visible(False)
    if values.ndim == 1:
        image: NDArray[np.float32] = torch.full(inside.shape, torch.nan).numpy()
        image[inside.numpy()] = values.numpy()
        ax.imshow(image, cmap="inferno", vmin=0, vmax=_ERROR_SCALE, interpolation="nearest")
        return
    image = torch.zeros(*inside.shape, 4).numpy()
    image[inside.numpy(), :3] = values.float().clamp(0, 1).numpy()
    image[inside.numpy(), 3] = 1
    ax.imshow(image, interpolation="nearest")


def chart_curves(report: SynthesisReport, path: Path) -> bool:
    """The paper's figure 8: PSNR over time, a panel a case; ceilings dotted. Writes nothing and
    returns False where no such case was scored.
    """
    shown = [name for name in SHOWCASES if name in report.cases]
    if not shown:
        return False
    columns = min(2, len(shown))
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(10, 3.2 * rows + 0.6), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for ax, name in zip(axes, shown, strict=False):
        _curves(ax, report.cases[name])
        ax.set_title(name, fontsize=10)
    for ax in axes[len(shown) :]:
        ax.set_visible(False)
    handles, labels = max((ax.get_legend_handles_labels() for ax in axes), key=lambda x: len(x[1]))
    figure.legend(handles, labels, loc="outside upper center", ncols=5, frameon=False)
    figure.savefig(path, dpi=100)
    return True


def _curves(ax: Axes, case: CaseResult) -> None:
    for name, curve in case.curves.items():
        style = {"color": COLORS[name], "linewidth": 2.6 if name == "ours" else 1.3}
        frames = np.array(curve.frames) + 1
        ax.plot(frames, curve.psnr, label=TITLES[name], **style)
        if name in case.ceilings:
            ceiling = case.ceilings[name]
            ax.plot(np.array(ceiling.frames) + 1, ceiling.psnr, ":", color=COLORS[name])
    ax.set_xlabel("frame (1 is given)")
    ax.set_ylabel("PSNR (dB)")
    ax.grid(color="#dddddd", linewidth=0.6)


def chart_statistics(report: SynthesisReport, path: Path) -> bool:
    """Distances of histograms and autocorrelations over time. Writes nothing and returns False
    where there are none.
    """
    shown = {name: case.statistics for name, case in report.cases.items() if case.statistics}
    if not shown:
        return False
    figure = Figure(figsize=(10, 2.8 * len(shown) + 0.5), layout="constrained")
    axes = figure.subplots(len(shown), 2, squeeze=False)
    for row, (case, statistics) in zip(axes, shown.items(), strict=True):
        for column, title in enumerate(("histogram", "autocorrelation")):
            for variant, found in statistics.items():
                frames = found["frames"]
                row[column].plot(
                    [frame + 1 for frame in frames],
                    [pair[column] for pair in frames.values()],
                    label=variant,
                )
            row[column].set_title(f"{case}: {title} distance", fontsize=10)
            row[column].set_xlabel("frame")
            row[column].grid(color="#dddddd", linewidth=0.6)
    axes[0, 0].legend(fontsize=8)
    figure.savefig(path, dpi=100)
    return True
