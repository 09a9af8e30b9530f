"""How well methods carry a change over to another material: `evaluate synthesis`."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterable
from collections.abc import Sequence as Names
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from model_runtime.contract import LSTM_LATENTS, LSTM_PARAMETERS
from model_runtime.model_files.weights import ENCODER, MODELS, list_models

from ...data.sequences import Sequence
from ..bench.encoders import WEIGHTS
from ..bench.results import chosen, write_report
from ..bench.spheres import TexturedSphere
from .cases import CASES, Case, make_cases
from .charts import SHOWCASES, Strip
from .domains import domain_roc
from .gallery import draw_figure_10, draw_gallery
from .methods import METHODS, Models, load_models
from .report import page
from .results import CaseResult, Curve, LearningCurves, SynthesisReport, averaged
from .scoring import Scored, Scorer
from .sources import Effort, SourceModels
from .stage import Stage

__all__ = ("evaluate_synthesis",)

_LEARNED = ("s2_a0.8_b0.2", "s3")
"""Cases on whose first material learning is shown: what parameters hold, and what only latents
do."""

_LEARNERS = ("ours", LSTM_PARAMETERS, LSTM_LATENTS)
_SHARES = (0.0625, 0.125, 0.25, 0.5, 1.0)


def evaluate_synthesis(
    data: Path,
    output: Path,
    *,
    pixels: int = 64,
    methods: Names[str] | None = None,
    cases: Names[str] | None = None,
    stride: int = 6,
    effort: Effort | None = None,
    encoder: Path = ENCODER,
    weights: Path = WEIGHTS,
    models: Path = MODELS,
) -> SynthesisReport:
    """Score `methods` on `cases` (default: all of `METHODS` and `CASES`); write `synthesis.json`,
    `.md` and pictures to `output`; of all cases also what the bundled NTMs do to real materials.

    PSNR in dB on the metric of docs/design.md: textures `pixels` wide, a texel a pixel. Methods
    that decode latents are scored on every `stride`-th row and column of the sphere and every fifth
    frame. What is learned and scored stays in `output`/kept, cell by cell, so that the next call,
    or one after an interruption, is quick. `encoder` is ours, `weights` the folder of the rivals',
    `models` that of the NTMs whose domains are judged.
    Raises `UsageError` for methods and cases that do not exist, `ModelFileError` for weights that
    are missing.
    """
    names, wanted = chosen("method", methods, METHODS), chosen("case", cases, CASES)
    start = time.perf_counter()
    folder = output / "kept"
    sources = SourceModels(folder, effort or Effort())
    trained = load_models(names, sources, encoder=encoder, weights=weights)
    domains = domain_roc(list_models((models,)), data)
    sphere = TexturedSphere.load(data / "hdri", pixels=pixels, stride=stride, folder=folder)
    every = tqdm(make_cases(data, wanted, size=pixels), desc="cases", unit=" case")
    scored, strips = _scored(every, names, sphere, trained, f"{pixels} {stride}")
    results = {name: _result(scored[name], names) for name in wanted if name in scored}
    minutes, learning = sources.minutes(), {}
    if cases is None and "ours" in names:
        learning = learning_curves(data, sphere, trained, size=pixels, look=f"{pixels} {stride}")
    settings = {"pixels": pixels, "stride": stride, "effort": asdict(sources.effort)}
    spent = time.perf_counter() - start
    report = SynthesisReport(results, minutes, settings, spent, domains, learning)
    output.mkdir(parents=True, exist_ok=True)
    parts = page(report, strips, output)
    if cases is None:
        draw_gallery(data, output / "gallery.png", folder=folder)
        draw_figure_10(data, output / "figure_10.png", folder=folder)
    write_report(output, "synthesis", parts, report)
    return report


@dataclass(frozen=True)
class _Material:
    """What was found on one material of a case, by method; `clamped` is the share of the truth's
    texels and frames that must be clamped to be rendered.
    """

    name: str
    found: dict[str, Scored]
    clamped: float


def _scored(
    cases: Iterable[Case], names: Names[str], sphere: TexturedSphere, trained: Models, look: str
) -> tuple[dict[str, list[_Material]], list[Strip]]:
    """The materials of every case, and the strips of those that are shown."""
    scored: dict[str, list[_Material]] = defaultdict(list)
    strips: list[Strip] = []
    source, methods = "", {}
    for case in cases:
        if case.source_key != source:  # methods serve all cases of a source
            source, methods = case.source_key, {}
        stage = partial(Stage.of, case, sphere)
        scorer = Scorer(case, stage, trained, trained.sources.folder, look, methods)
        found = {name: scorer.score(name) for name in names}
        if case.name in SHOWCASES and case.name not in scored:
            strips.append(Strip.of(scorer, found))
        truth = case.target
        clamped = float(truth.out_of_range().mean()) if isinstance(truth, Sequence) else 0.0
        scored[case.name].append(_Material(case.material, found, clamped))
    return scored, strips


def _result(materials: list[_Material], names: tuple[str, ...]) -> CaseResult:
    """Means over the materials of one case; of materials on which a method is dear and others on
    which it is not, the frames that all have.
    """

    def mean(kind: str) -> dict[str, Curve]:
        curves = {
            name: [m.found[name].curves[kind] for m in materials if kind in m.found[name].curves]
            for name in names
        }
        return {name: averaged(some) for name, some in curves.items() if some}

    ours = {m.name: m.found["ours"] for m in materials if "ours" in m.found}
    statistics: dict[str, dict[str, Any]] = {}
    for found in ours.values():
        for variant, rows in found.statistics.items():
            distances = torch.tensor(rows)
            statistics[variant] = {
                "histogram": round(float(distances[:, 1].mean()), 4),
                "autocorrelation": round(float(distances[:, 2].mean()), 4),
                "frames": {int(f): [round(h, 4), round(a, 4)] for f, h, a in rows},
            }
    return CaseResult(
        curves=mean("score"),
        ceilings=mean("ceiling"),
        after_fit=mean("after_fit"),
        two_lobes=mean("two_lobes"),
        three_lobes=mean("three_lobes"),
        true_onset=mean("true_onset"),
        statistics=statistics,
        chosen={name: found.chosen for name, found in ours.items() if found.chosen},
        clamped=float(np.mean([m.clamped for m in materials])),
    )


def learning_curves(
    data: Path, sphere: TexturedSphere, models: Models, *, size: int, look: str
) -> LearningCurves:
    """How long a source must be learned from: the ladder trained with a sixteenth to all of the
    iterations, each from the start.

    `size` and `look` are those of the report's cases, `size` the width of their patches.
    """
    found: dict[str, dict[str, list[tuple[float, float]]]] = {}
    effort, (representation, encoder) = models.sources.effort, models.encoders["ours"]
    for name in _LEARNED:
        case = next(make_cases(data, (name,), size=size))
        stage = Stage.of(case, sphere)
        curves = found[name] = {method: [] for method in _LEARNERS}
        for share in _SHARES:
            ladder = replace(effort.ladder, iterations=round(effort.ladder.iterations * share))
            folder = models.sources.folder / f"iterations_{ladder.iterations}"
            sources = SourceModels(folder, replace(effort, ladder=ladder))
            ntm = sources.ladder(case.source_key, case.source, representation, encoder)
            trained = replace(models, sources=sources)
            scorer = Scorer(case, lambda stage=stage: stage, trained, folder, look)
            for method, curve in curves.items():
                psnr = round(scorer.score(method).curves["score"].mean, 2)
                curve.append((ntm.card.trained["minutes"], psnr))
    return found
