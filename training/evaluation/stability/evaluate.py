"""Where methods fail, and whether the product notices: `evaluate stability`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from collections.abc import Sequence as Names
from dataclasses import asdict
from pathlib import Path

import torch
from torch import Tensor
from tqdm import tqdm

from model_runtime.model_files.weights import ENCODER
from model_runtime.representation.paper import PaperRepresentation
from model_runtime.states import rows_of

from ...ntm import NTMConfig
from ..bench.encoders import WEIGHTS
from ..bench.kept import code, identity, kept_json
from ..bench.results import chosen, write_report
from ..bench.spheres import TexturedSphere
from ..synthesis.methods import load_models
from ..synthesis.sources import Effort, SourceModels, describe
from .inputs import INPUTS
from .learning import LEARNING
from .measured import MEASURED
from .report import draw_chart, page
from .results import MethodResult, StabilityReport
from .runs import Outcome, Trials
from .targets import TARGETS
from .trials import EVERY, Stress, Trial, TrialSetup

__all__ = ("STRESSES", "evaluate_stability")

STRESSES: Mapping[str, Stress] = {**TARGETS, **INPUTS, **MEASURED, **LEARNING}
"""By name."""

_PROBES = 64  # directions that identify a measured material
_EFFORT = Effort(NTMConfig(iterations=250, batch=64), 384, NTMConfig(iterations=300, batch=48), 32)


def evaluate_stability(
    data: Path,
    output: Path,
    *,
    pixels: int = 48,
    methods: Names[str] | None = None,
    stresses: Names[str] | None = None,
    stride: int = 8,
    effort: Effort = _EFFORT,
    weights: Path = WEIGHTS,
) -> StabilityReport:
    """Put `methods` under `stresses` (default: all of `EVERY` and `STRESSES`); write
    `stability.json`, `.md` and `.png` to `output`.

    PSNR in dB on the metric of docs/design.md, as in `evaluate_synthesis`: textures `pixels` wide,
    dear methods scored on every `stride`-th row and column. What is learned and scored stays in
    `output`/kept, so that the next call, or one after an interruption, is quick. `weights` is the
    folder of the rivals' encoders; ours is the bundled one, as `age` uses no other.
    Raises `UsageError` for methods and stresses that do not exist, `ModelFileError` for weights
    that are missing.
    """
    names, wanted = chosen("method", methods, EVERY), chosen("stress", stresses, STRESSES)
    start = time.perf_counter()
    folder = output / "kept"
    models = load_models(names, SourceModels(folder, effort), encoder=ENCODER, weights=weights)
    sphere = TexturedSphere.load(data / "hdri", pixels=pixels, stride=stride, folder=folder)
    trials, setup = Trials(models, sphere), TrialSetup(data, pixels)
    outcomes: dict[str, dict[str, dict[float, Outcome]]] = {}
    cells = [(name, x) for name in wanted for x in STRESSES[name].severities]
    for name, x in tqdm(cells, desc="stresses", unit=" trial"):
        trial = STRESSES[name].make(setup, x)
        described = _description(trial, f"{pixels} {stride} {effort} {code()}")
        for method in names:
            if method in STRESSES[name].methods:
                outcome = _outcome(folder, identity(described, method), trial, method, trials)
                outcomes.setdefault(name, {}).setdefault(method, {})[x] = outcome
    found = {
        name: {method: MethodResult(each, method == "ours") for method, each in methods.items()}
        for name, methods in outcomes.items()
    }
    settings = {"pixels": pixels, "stride": stride, "effort": asdict(effort)}
    report = StabilityReport(found, settings, time.perf_counter() - start)
    output.mkdir(parents=True, exist_ok=True)
    draw_chart(report, STRESSES, output / "stability.png")
    write_report(output, "stability", page(report, STRESSES), report)
    return report


def _description(trial: Trial, settings: str) -> str:
    """What identifies a trial."""
    parts: list[Tensor | str] = [describe(trial.case.source), describe(trial.case.target), settings]
    if trial.given is not None:
        parts.append(rows_of(trial.given))
    if trial.unscored is not None:
        parts.append(torch.from_numpy(trial.unscored))
    if trial.measured is not None:
        angles = PaperRepresentation().sample_angles(_PROBES)
        parts.append(trial.measured.evaluate(angles))
    rest = (trial.last_only, trial.span, trial.palette, trial.samples, trial.dtype)
    return identity(*parts, str(rest), "" if trial.killed is None else f"{trial.killed}")


def _outcome(folder: Path, made_from: str, trial: Trial, method: str, trials: Trials) -> Outcome:
    """From an earlier run, or another stress that is as harmless, or anew."""
    path = folder / f"trial_{made_from[:20]}.json"
    found = kept_json(path, made_from, lambda: asdict(trials.run(trial, method)))
    return Outcome(found["psnr"], found["in_gamut"], tuple(found["said"]))
