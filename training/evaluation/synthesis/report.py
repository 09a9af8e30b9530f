"""The report `synthesis` for readers: `synthesis.md` and the images it shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from ..bench.charts import LOOKS
from ..bench.results import image, table
from .cases import ALPHAS, BETAS, GRID, MIXTURES, PBR
from .charts import (
    Strip,
    chart_curves,
    chart_domains,
    chart_minutes,
    chart_statistics,
    draw_strip,
)
from .results import Curve, SynthesisReport

__all__ = ("PUBLISHED", "averages_table", "grid_table", "other_table", "page", "tables")

Row = Sequence[float]

_ALPHA, _BETA = "\N{GREEK SMALL LETTER ALPHA}", "\N{GREEK SMALL LETTER BETA}"

PUBLISHED: Mapping[tuple[str, str, str], Row] = {
    (number, model, method): tuple(map(float, row.split()))
    for number, model, method, row in (
        ("mean", "s1", "paper", "39.9 40.2 41.7 39.3 39.4 40.2 40.5 40.5 40.6 40.5"
         " 39.2 39.4 39.3 41.1 39.3 40.1"),
        ("mean", "s1", "stt", "39.2 40.2 40.2 39.8 39.1 38.1 38.9 38.9 38.5 38.0"
         " 37.1 38.0 37.7 37.5 37.1 38.5"),
        ("mean", "s2", "paper", "42.4 43.3 41.6 39.0 38.0 42.7 42.8 40.4 39.0 37.9"
         " 42.5 42.8 41.1 39.4 38.0 40.7"),
        ("mean", "s2", "stt", "47.1 44.9 40.3 37.4 35.6 45.6 43.7 39.7 37.1 35.4"
         " 44.2 42.6 38.9 36.7 35.2 40.3"),
        ("final", "s1", "paper", "39.9 41.1 42.1 41.1 41.3 39.7 40.3 37.6 36.1 40.3"
         " 36.5 36.8 38.0 39.6 38.0 39.2"),
        ("final", "s1", "stt", "32.1 32.3 32.4 32.4 32.5 30.6 30.8 30.8 30.9 30.9"
         " 29.4 29.5 29.6 29.6 29.6 30.9"),
        ("final", "s2", "paper", "41.5 41.2 38.5 35.5 35.8 42.3 40.5 37.4 37.5 36.7"
         " 41.9 41.5 40.3 38.9 38.4 39.2"),
        ("final", "s2", "stt", "42.9 39.8 37.3 35.5 34.3 39.4 37.4 35.8 34.6 33.7"
         " 36.2 35.1 34.1 33.4 32.9 36.2"),
    )
}  # fmt: skip
"""The paper's tables 1 (mean over time) and 2 (final frame): dB by number, model and method, in the
order of `GRID`, the average last. Its own textures, renderer and environment map."""

_CHARTS = (
    ("synthesis_curves.png", chart_curves, "PSNR over time; ceilings are dotted", ""),
    ("synthesis_statistics.png", chart_statistics, "Distances over time", ""),
    ("synthesis_minutes.png", chart_minutes, "PSNR by minutes of training", "Learning curves"),
)
_PUBLISHERS = {"paper": "its method", "stt": "its STT"}
_NUMBERS = {"mean": "Mean over time (the paper's table 1)", "final": "Final frame (its table 2)"}


Kinds = Sequence[tuple[str, str]]
_CURVES: Kinds = (("curves", ""), ("ceilings", ", ceiling"))
_EVERY: Kinds = (
    _CURVES[0],
    ("after_fit", ", after the fit"),
    ("two_lobes", ", after the fit of 2 lobes"),
    ("three_lobes", ", after the fit of 3 lobes"),
    ("true_onset", ", true onset given"),
    _CURVES[1],
)


def _methods(kinds: Kinds) -> Iterator[tuple[str, str, str]]:
    """Every method, what its row is called, and the kind of curve in it."""
    for method, look in LOOKS.items():
        for kind, suffix in kinds:
            yield method, look.title + suffix, kind


def grid_table(report: SynthesisReport, number: str) -> str:
    """The paper's table of `number` ("mean" or "final"), a row a method, its own rows below."""
    rows = []
    for family in ("s1", "s2"):
        names = [name for name in GRID if GRID[name][0] == family]
        for method, title, kind in _methods(_CURVES):
            values = [_number(report, name, kind, method, number) for name in names]
            if any(value is not None for value in values):
                rows.append([family.upper(), *_row(title, [*values, _mean(values)])])
        for (n, f, method), published in PUBLISHED.items():
            if (n, f) == (number, family):
                title = f"*published, other textures: {_PUBLISHERS[method]}*"
                rows.append([family.upper(), *_row(title, published)])
    cells = [f"{_ALPHA} {a:g} {_BETA} {b:g}" for a in ALPHAS for b in BETAS]
    return table(["dB", "method", *cells, "Avg."], rows)


def averages_table(report: SynthesisReport) -> str:
    """The tables' last column: averages over all cells of S1 and of S2, published ones below."""
    columns = [(family, number) for number in _NUMBERS for family in ("s1", "s2")]
    rows = []
    for method, title, kind in _methods(_CURVES):
        values = [
            _mean([_number(report, n, kind, method, number) for n in GRID if GRID[n][0] == family])
            for family, number in columns
        ]
        if any(value is not None for value in values):
            rows.append(_row(title, values))
    for method, who in _PUBLISHERS.items():
        values = [PUBLISHED[number, family, method][-1] for family, number in columns]
        rows.append(_row(f"*published, other textures: {who}*", values))
    return table(["dB, averages", *(f"{f.upper()}, {number}" for f, number in columns)], rows)


def _number(
    report: SynthesisReport, name: str, kind: str, method: str, number: str
) -> float | None:
    case = report.cases.get(name)
    curve = None if case is None else getattr(case, kind).get(method)
    return None if curve is None else curve.json()[number]


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _row(title: str, values: Sequence[float | None]) -> list[str]:
    return [title, *("" if value is None else f"{value:.1f}" for value in values)]


def other_table(report: SynthesisReport) -> str:
    """The other cases, `mean / final / min` in dB."""
    names = [name for name in report.cases if name not in GRID]
    rows = []
    for kind in _EVERY:
        for method, title, curves in _methods((kind,)):
            found = [getattr(report.cases[name], curves).get(method) for name in names]
            if any(found):
                rows.append([title, *(_three(curve) if curve else "" for curve in found)])
    return table(["dB, mean / final / min", *names], rows)


def _three(curve: Curve) -> str:
    return " / ".join(f"{value:.1f}" for value in curve.json().values())


def _statistics_table(report: SynthesisReport) -> str:
    shown = {name: case.statistics for name, case in report.cases.items() if case.statistics}
    variants = list(dict.fromkeys(v for statistics in shown.values() for v in statistics))
    rows = []
    for name, statistics in shown.items():
        found = [statistics.get(variant) for variant in variants]
        texts = [f"{f['histogram']:.3f} / {f['autocorrelation']:.3f}" if f else "" for f in found]
        rows.append([name, *texts])
    return table(["histogram / autocorrelation distance", *variants], rows)


def _domains_table(report: SynthesisReport) -> str:
    rows = []
    for name, result in report.domains.items():
        fitting = len(result.fitting)
        foreign = len(result.outside) - fitting
        accepted = sum(material in result.fitting for material in result.accepted)
        refused = sum(material not in result.fitting for material in result.refused)
        counts = (f"{accepted} of {fitting}", f"{refused} of {foreign}")
        rows.append([name, f"{result.json()['auroc']:.3f}", *counts, ", ".join(result.wrong)])
    head = ("model", "AUROC", "fitting materials accepted", "foreign ones refused", "wrong")
    return table(head, rows)


def _explanation(report: SynthesisReport) -> str:
    pixels, stride = report.settings["pixels"], report.settings["stride"]
    minutes = ", ".join(f"{name} {value:.2g}" for name, value in report.train_minutes.items())
    pairs = " and ".join(" to ".join(pair) for pair in MIXTURES)
    return f"""PSNR in dB of tone-mapped spheres, {pixels} pixels wide, averaged over three \
environment maps, then over materials.

- A texel is a pixel: patches of {pixels} x {pixels} texels of {", ".join(PBR)} (ambientCG), \
source and target apart from each other; halves of real materials are sampled at the nearest texel.
- The first frame is given to every method, and methods that are anchored to it have it exactly: \
it is in no number. The paper does not say whether it counts it.
- `paper`, `brdfnps` and whatever decodes latents are scored on every {stride}th row and column of \
the sphere and on the second and every fifth frame; between those the curve is a line.
- `paper` and `brdfnps`: encoder, decoder and LSTM as published, nothing added. `ceiling`: the \
true latents of four frames, decoded, without any model of change.
- Every rung, and `ours`, models each texel for itself (no palette) and is anchored as in the \
product. A model is trained on a source once: cells that differ only in β or δ share it, as these \
change the target alone.
- S1 and S2 are channelwise affine in the initial value: the affine rung solves them, and they say \
little about a neural model.
- S3: mixtures of {pairs} (MERL, held out from all encoders); methods with latents are scored as \
decoded, and after the fit of one lobe to them; ours also \
after that of two and of three, which are followed from one scored frame to the next.
- S4: the source's onset is known to the ladder, that of the target only under `true onset given`. \
Of real materials it is estimated, where they have a timing that the first frame does not tell. \
Without an onset, texels show the mean over the source's timing.
- Left halves train, right halves are the truth; SteelRusting has no gloss; SnowyGround is at half \
its resolution.
- Minutes of one training, one core: {minutes}.
"""


def tables(report: SynthesisReport) -> str:
    """Everything scored, as Markdown."""
    parts = []
    if any(name in GRID for name in report.cases):
        parts += ["## Averages of the paper's tables", averages_table(report)]
        for number, title in _NUMBERS.items():
            parts += [f"## {title}", grid_table(report, number)]
    if any(name not in GRID for name in report.cases):
        parts += ["## Other cases", other_table(report)]
    if any(case.statistics for case in report.cases.values()):
        parts += [
            "## Spots: statistics of maps",
            _statistics_table(report),
            "Means over frames and maps of square roots of values; 0 is the truth. `seeded`: the"
            " product with its seeded pattern, mean of three seeds; `estimated`: the same where the"
            " source's onset was hidden from it; `none`: without any; `fade`:"
            " the mean over texels, affine in the first frame; `constant`: a still image.",
        ]
    if report.domains:
        parts += ["## Domains of the bundled models", _domains_table(report)]
    return "\n\n".join(parts)


def page(report: SynthesisReport, strips: Sequence[Strip], folder: Path) -> list[str]:
    """The paragraphs of `synthesis.md`; draws its charts and its strips to `folder`."""
    parts = ["# Synthesis of time-varying materials", _explanation(report), tables(report)]
    for file, draw, title, text in _CHARTS:
        if draw(report, folder / file):
            parts += [f"## {title}", image(file, text or title)]
    if chart_domains(report.domains, folder / "domains.png"):
        parts += ["## What the models know", image("domains.png", "ROC curves of the domains")]
    for strip in strips:
        file = f"strip_{strip.case.key}.png"
        draw_strip(strip, folder / file)
        parts += [f"## {strip.case.name}: {strip.case.material}", image(file, strip.case.name)]
    return parts
