"""The report `synthesis` for readers: `synthesis.md` and the images it shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from .cases import ALPHAS, BETAS, GRID, MIXTURES, PBR
from .charts import TITLES, Strip, chart_curves, chart_statistics, draw_strip
from .domains import chart_domains
from .minutes import chart_minutes
from .results import Curve, SynthesisReport

__all__ = ("PUBLISHED", "averages_table", "grid_table", "other_table", "tables", "write_report")

Row = Sequence[float]

_ALPHA, _BETA = "\N{GREEK SMALL LETTER ALPHA}", "\N{GREEK SMALL LETTER BETA}"

PUBLISHED: Mapping[tuple[str, str, str], Row] = {
    ("mean", "s1", "paper"): (
        *(39.9, 40.2, 41.7, 39.3, 39.4),
        *(40.2, 40.5, 40.5, 40.6, 40.5),
        *(39.2, 39.4, 39.3, 41.1, 39.3, 40.1),
    ),
    ("mean", "s1", "stt"): (
        *(39.2, 40.2, 40.2, 39.8, 39.1),
        *(38.1, 38.9, 38.9, 38.5, 38.0),
        *(37.1, 38.0, 37.7, 37.5, 37.1, 38.5),
    ),
    ("mean", "s2", "paper"): (
        *(42.4, 43.3, 41.6, 39.0, 38.0),
        *(42.7, 42.8, 40.4, 39.0, 37.9),
        *(42.5, 42.8, 41.1, 39.4, 38.0, 40.7),
    ),
    ("mean", "s2", "stt"): (
        *(47.1, 44.9, 40.3, 37.4, 35.6),
        *(45.6, 43.7, 39.7, 37.1, 35.4),
        *(44.2, 42.6, 38.9, 36.7, 35.2, 40.3),
    ),
    ("final", "s1", "paper"): (
        *(39.9, 41.1, 42.1, 41.1, 41.3),
        *(39.7, 40.3, 37.6, 36.1, 40.3),
        *(36.5, 36.8, 38.0, 39.6, 38.0, 39.2),
    ),
    ("final", "s1", "stt"): (
        *(32.1, 32.3, 32.4, 32.4, 32.5),
        *(30.6, 30.8, 30.8, 30.9, 30.9),
        *(29.4, 29.5, 29.6, 29.6, 29.6, 30.9),
    ),
    ("final", "s2", "paper"): (
        *(41.5, 41.2, 38.5, 35.5, 35.8),
        *(42.3, 40.5, 37.4, 37.5, 36.7),
        *(41.9, 41.5, 40.3, 38.9, 38.4, 39.2),
    ),
    ("final", "s2", "stt"): (
        *(42.9, 39.8, 37.3, 35.5, 34.3),
        *(39.4, 37.4, 35.8, 34.6, 33.7),
        *(36.2, 35.1, 34.1, 33.4, 32.9, 36.2),
    ),
}
"""The paper's tables 1 (mean over time) and 2 (final frame): dB by number, model and method, in the
order of `GRID`, the average last. Its own textures, renderer and environment map."""

_PUBLISHERS = {"paper": "its method", "stt": "its STT"}
_NUMBERS = {"mean": "Mean over time (the paper's table 1)", "final": "Final frame (its table 2)"}


def grid_table(report: SynthesisReport, number: str) -> str:
    """The paper's table of `number` ("mean" or "final"), a row a method, its own rows below."""
    cells = [f"{_ALPHA} {a:g} {_BETA} {b:g}" for a in ALPHAS for b in BETAS]
    lines = ["| dB | method | " + " | ".join([*cells, "Avg."]) + " |"]
    lines.append("|---" * (len(cells) + 3) + "|")
    for family in ("s1", "s2"):
        names = [name for name in GRID if GRID[name][0] == family]
        scored = [report.cases[name] for name in names if name in report.cases]
        for method, title in TITLES.items():
            for label, kind in ((title, "curves"), (f"{title}, ceiling", "ceilings")):
                if not any(method in getattr(case, kind) for case in scored):
                    continue
                values = [
                    _number(getattr(report.cases[name], kind).get(method), number)
                    if name in report.cases
                    else None
                    for name in names
                ]
                lines.append(_row(family, label, [*values, _mean(values)]))
        for (n, f, method), row in PUBLISHED.items():
            if (n, f) == (number, family):
                title = f"*published, other textures: {_PUBLISHERS[method]}*"
                lines.append(_row(family, title, row))
    return "\n".join(lines)


def averages_table(report: SynthesisReport) -> str:
    """The tables' last column: averages over all cells of S1 and of S2, published ones below."""
    columns = [(family, number) for number in _NUMBERS for family in ("s1", "s2")]
    titles = " | ".join(f"{family.upper()}, {number}" for family, number in columns)
    lines = [f"| dB, averages | {titles} |", "|---" * (len(columns) + 1) + "|"]
    for method, title in TITLES.items():
        for label, kind in ((title, "curves"), (f"{title}, ceiling", "ceilings")):
            values = [
                _mean(
                    [
                        _number(getattr(case, kind).get(method), number)
                        for name, case in report.cases.items()
                        if GRID.get(name, ("",))[0] == family
                    ]
                )
                for family, number in columns
            ]
            if any(value is not None for value in values):
                lines.append(_texts(label, values))
    for method, who in _PUBLISHERS.items():
        values = [PUBLISHED[number, family, method][-1] for family, number in columns]
        lines.append(_texts(f"*published, other textures: {who}*", values))
    return "\n".join(lines)


def _number(curve: Curve | None, number: str) -> float | None:
    return None if curve is None else curve.json()[number]


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _row(family: str, title: str, values: Sequence[float | None]) -> str:
    return f"| {family.upper()} {_texts(title, values)}"


def _texts(title: str, values: Sequence[float | None]) -> str:
    texts = ["" if value is None else f"{value:.1f}" for value in values]
    return "| " + " | ".join([title, *texts]) + " |"


def other_table(report: SynthesisReport) -> str:
    """The other cases, `mean / final / min` in dB."""
    names = [name for name in report.cases if name not in GRID]
    lines = ["| dB, mean / final / min | " + " | ".join(names) + " |"]
    lines.append("|---" * (len(names) + 1) + "|")
    for kind, suffix in (
        ("curves", ""),
        ("after_fit", ", after the fit"),
        ("true_onset", ", true onset given"),
        ("ceilings", ", ceiling"),
    ):
        for method, title in TITLES.items():
            found = [getattr(report.cases[name], kind).get(method) for name in names]
            if any(found):
                texts = ["" if curve is None else _three(curve) for curve in found]
                lines.append("| " + " | ".join([title + suffix, *texts]) + " |")
    return "\n".join(lines)


def _three(curve: Curve) -> str:
    return " / ".join(f"{value:.1f}" for value in curve.json().values())


def _statistics_table(report: SynthesisReport) -> str:
    shown = {name: case.statistics for name, case in report.cases.items() if case.statistics}
    variants = list(dict.fromkeys(v for statistics in shown.values() for v in statistics))
    lines = ["| histogram / autocorrelation distance | " + " | ".join(variants) + " |"]
    lines.append("|---" * (len(variants) + 1) + "|")
    for name, statistics in shown.items():
        texts = [
            f"{found['histogram']:.3f} / {found['autocorrelation']:.3f}" if found else ""
            for found in (statistics.get(variant) for variant in variants)
        ]
        lines.append("| " + " | ".join([name, *texts]) + " |")
    return "\n".join(lines)


def _domains_table(report: SynthesisReport) -> str:
    lines = ["| model | AUROC | fitting materials accepted | foreign ones refused | wrong |"]
    lines.append("|---" * 5 + "|")
    for name, result in report.domains.items():
        found = result.json()
        fitting = len(result.fitting)
        foreign = len(result.outside) - fitting
        accepted = sum(material in result.fitting for material in found["accepted"])
        refused = sum(material not in result.fitting for material in found["refused"])
        counts = f"{accepted} of {fitting} | {refused} of {foreign}"
        lines.append(f"| {name} | {found['auroc']:.3f} | {counts} | {', '.join(found['wrong'])} |")
    return "\n".join(lines)


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
decoded, and after the fit of textures to them.
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


def write_report(report: SynthesisReport, strips: Sequence[Strip], folder: Path) -> None:
    """Write `synthesis.md`, its charts and its strips to `folder`."""
    parts = ["# Synthesis of time-varying materials", _explanation(report), tables(report)]
    for file, draw, title in (
        ("synthesis_curves.png", chart_curves, "PSNR over time; ceilings are dotted"),
        ("synthesis_statistics.png", chart_statistics, "Distances over time"),
    ):
        if draw(report, folder / file):
            parts += [f"## {title}", f"![{title}]({file})"]
    if chart_minutes(report.learning, folder / "synthesis_minutes.png"):
        parts += ["## PSNR by minutes of training", "![Learning curves](synthesis_minutes.png)"]
    if chart_domains(report.domains, folder / "domains.png"):
        parts += ["## What the models know", "![ROC curves of the domains](domains.png)"]
    for strip in strips:
        file = f"strip_{strip.case.key}.png"
        draw_strip(strip, folder / file)
        parts += [f"## {strip.case.name}: {strip.case.material}", f"![{strip.case.name}]({file})"]
    (folder / "synthesis.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
