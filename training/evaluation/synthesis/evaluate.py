"""How well methods carry a change over to another material: `evaluate synthesis`."""

from __future__ import annotations

import json
import time
from collections import defaultdict
from collections.abc import Sequence as Names
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from model_runtime.errors import UsageError
from model_runtime.model_files.weights import ENCODER, MODELS, list_models

from ...data.sequences import Sequence
from ..representation.methods import WEIGHTS
from .cases import CASES, Case, make_cases
from .charts import SHOWCASES, Strip
from .domains import domain_roc
from .gallery import draw_figure_10, draw_gallery
from .methods import METHODS, load_models
from .minutes import learning_curves
from .report import write_report
from .results import CaseResult, Curve, SynthesisReport, averaged
from .scoring import Scored, Scorer
from .sphere import TexturedSphere
from .stage import Stage
from .training import Effort, School

__all__ = ("evaluate_synthesis",)


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
    names, wanted = tuple(methods or METHODS), tuple(cases or CASES)
    unknown = [name for name in wanted if name not in CASES]
    if unknown:
        raise UsageError(f"There is no case '{unknown[0]}'.", f"Choose among {', '.join(CASES)}.")
    start = time.perf_counter()
    kept = output / "kept"
    school = School(kept, effort or Effort())
    taught = load_models(names, school, encoder=encoder, weights=weights)
    domains = domain_roc(list_models((models,)), data)
    sphere = TexturedSphere.load(data / "hdri", pixels=pixels, stride=stride, kept=kept)
    look = f"{pixels} {stride}"

    scored: dict[str, dict[str, dict[str, Scored]]] = defaultdict(dict)
    clamped: dict[str, list[float]] = defaultdict(list)
    strips: list[Strip] = []
    learned: dict[str, Any] = {}
    for case in tqdm(make_cases(data, wanted, size=pixels), desc="cases", unit=" case"):
        if learned.get("source") != case.source_key:  # methods serve all cases of a source
            learned = {"source": case.source_key, "methods": {}}
        scorer = Scorer(
            case,
            lambda case=case: Stage.of(case, sphere),
            taught,
            kept,
            look,
            learned["methods"],
        )
        found = {name: scorer.score(name) for name in names}
        if case.name in SHOWCASES and all(strip.case.name != case.name for strip in strips):
            strips.append(Strip.of(scorer, found))
        scored[case.name][case.material] = found
        clamped[case.name].append(_clamped(case))
    results = {
        name: _result(scored[name], clamped[name], names) for name in wanted if name in scored
    }
    minutes = school.minutes()
    settings = {"pixels": pixels, "stride": stride, "effort": asdict(school.effort)}
    learning = {}
    if cases is None and "ours" in names:
        learning = learning_curves(data, sphere, taught, size=pixels, look=look)
    report = SynthesisReport(
        results, minutes, settings, time.perf_counter() - start, domains, learning
    )
    output.mkdir(parents=True, exist_ok=True)
    write_report(report, strips, output)
    if cases is None:
        draw_gallery(data, output / "gallery.png", kept=kept)
        draw_figure_10(data, output / "figure_10.png", kept=kept)
    text = json.dumps(report.json(), indent=1)
    (output / "synthesis.json").write_text(text, encoding="utf-8")
    return report


def _clamped(case: Case) -> float:
    """The share of the truth's texels and frames that must be clamped to be rendered."""
    target = case.target
    return float(target.out_of_range().mean()) if isinstance(target, Sequence) else 0.0


def _result(
    materials: dict[str, dict[str, Scored]], clamped: list[float], names: tuple[str, ...]
) -> CaseResult:
    """Means over the materials of one case; of materials on which a method is dear and others on
    which it is not, the frames that all have.
    """

    def mean(kind: str) -> dict[str, Curve]:
        curves = {
            name: [
                found[name].curves[kind]
                for found in materials.values()
                if kind in found[name].curves
            ]
            for name in names
        }
        return {name: averaged(some) for name, some in curves.items() if some}

    statistics: dict[str, dict[str, Any]] = {}
    for found in materials.values():
        for variant, rows in found["ours"].statistics.items() if "ours" in found else ():
            statistics[variant] = {
                "histogram": round(float(rows[:, 1].mean()), 4),
                "autocorrelation": round(float(rows[:, 2].mean()), 4),
                "frames": {int(f): [round(h, 4), round(a, 4)] for f, h, a in rows.tolist()},
            }
    chosen = {
        material: found["ours"].chosen
        for material, found in materials.items()
        if "ours" in found and found["ours"].chosen
    }
    return CaseResult(
        curves=mean("score"),
        ceilings=mean("ceiling"),
        after_fit=mean("after_fit"),
        true_onset=mean("true_onset"),
        statistics=statistics,
        chosen=chosen,
        clamped=float(np.mean(clamped)),
    )
