"""Whether a dye fades as one that was measured: alizarin lake in titanium white.

Johnston-Feller, Feller, Bailie and Curran (The Kinetics of Fading, Journal of the American
Institute for Conservation 23, 1984) found from spectra, by Kubelka and Munk's K/S, that its
concentration falls by first-order kinetics, at a rate that is essentially the same whatever there
was at first. Held against that here are the formulas that the bundled model learned from, and the
model: the logarithm of K/S where the paint absorbs should be a line over the dose, of one slope.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

from model_runtime.channels import KD
from model_runtime.model_files.weights import find_model
from model_runtime.modelling.rollout import roll_out
from model_runtime.representation import load_representation
from model_runtime.temporal.ntm import NeuralTemporalModel

from ...data.kinetics import history
from ...data.weathering_states import absorption, reflectance
from ..bench import results
from ..bench.charts import grid, save
from ..bench.results import Result, image, write_report

__all__ = ("FadingReport", "evaluate_fading", "table")

Array = NDArray[np.floating]

_RED = np.array([0.06, 1.0, 0.55])  # absorbs green most, and lets red through
_WHITE = 0.004  # K/S of titanium white
_CONCENTRATIONS = (0.25, 0.5, 1.0, 2.0)  # K/S at the absorption
_KS, _ALPHA = 0.04, 0.5
_GREEN = 1
_LEFT = 0.25  # of the dye: with less, what lasts and the chalk of the binder are measured, too
_COLORS = ("#E69F00", "#CC79A7", "#D55E00", "#7A1F1F")


@dataclass(frozen=True)
class Faded(Result):
    """Of one concentration: K/S of the dye [T] at evenly spaced doses, as a share of the first, the
    rate of the straight line through its logarithm, and how far it lies from that at most.
    """

    JSON = (("concentration", None), ("left", None), ("rate", None), ("off", None))

    concentration: float
    left: list[float]
    rate: float
    off: float

    @classmethod
    def of(cls, concentration: float, kd: Array) -> Faded:
        dye = absorption(kd[:, _GREEN] / (1 - _KS)) - _WHITE
        left = (dye / dye[0]).clip(1e-6)
        counts = left > _LEFT
        dose = np.linspace(0, 1, len(left))[counts]
        slope = float((dose * -np.log(left[counts])).sum() / (dose * dose).sum())
        off = np.abs(np.exp(-slope * dose) - left[counts]).max()
        return cls(concentration, left.round(4).tolist(), round(slope, 3), round(float(off), 4))


@dataclass(frozen=True)
class FadingReport(Result):
    """By what made them, `formulas` and `model`, a result for each concentration."""

    JSON = (("methods", None),)

    methods: dict[str, list[Faded]]


def evaluate_fading(output: Path) -> FadingReport:
    """Writes `fading.json`, `.md` and the chart that it shows to a folder."""
    bodies = np.array([reflectance(_WHITE + c * _RED) for c in _CONCENTRATIONS], np.float32)
    kd = bodies * (1 - _KS)
    representation, identity = load_representation()
    ntm = NeuralTemporalModel.load(find_model("fading"), identity)
    ages = np.linspace(0, 1, ntm.frames, dtype=np.float32)
    ks, alpha = np.full_like(kd, _KS), np.full(len(kd), _ALPHA, np.float32)
    formulas = np.stack([history("fading", kd, ks, alpha, age)[0] for age in ages], 1)
    entries = torch.from_numpy(np.concatenate((kd, ks, alpha[:, None]), 1))
    with torch.inference_mode():
        model = roll_out(entries, ntm, ntm.chosen, representation).states[..., KD].numpy()
    report = FadingReport(
        {
            name: [Faded.of(c, each) for c, each in zip(_CONCENTRATIONS, found, strict=True)]
            for name, found in (("formulas", formulas), ("model", model))
        }
    )
    output.mkdir(parents=True, exist_ok=True)
    save(_chart(report), output / "fading.png")
    write_report(output, "fading", [table(report), image("fading.png", "dye left by dose")], report)
    return report


def table(report: FadingReport) -> str:
    """A row a concentration: rates, and how far the curves lie from straight lines."""
    rows = [
        [f"{each.concentration}", name, f"{each.rate}", f"{each.off}"]
        for name, found in report.methods.items()
        for each in found
    ]
    for name, found in report.methods.items():
        rates = [each.rate for each in found]
        rows.append(["all", name, f"{min(rates)} to {max(rates)}", ""])
    return results.table(["K/S at first", "", "rate", "off the line, share of the dye"], rows)


def _chart(report: FadingReport) -> Figure:
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    ax = figure.subplots()
    for color, line, dots in zip(_COLORS, *report.methods.values(), strict=True):
        dose = np.linspace(0, 1, len(line.left))
        ax.semilogy(dose, line.left, color=color, label=f"K/S {line.concentration} at first")
        ax.semilogy(dose, dots.left, "o", color=color, markersize=3)
    rate = np.mean([each.rate for each in report.methods["formulas"]])
    ax.semilogy(dose, np.exp(-rate * dose), "--", color="#888888", label="first order")
    ax.set_ylim(0.05, 1.1)
    grid(ax, "A red dye by the light it has had", "dose (1: the end of the model)", "dye left")
    ax.legend(fontsize=8, title="lines: formulas, dots: bundled model", title_fontsize=8)
    return figure
