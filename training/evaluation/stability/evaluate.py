"""Where methods fail, and whether the product notices: `evaluate stability`."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from collections.abc import Sequence as Names
from dataclasses import asdict
from pathlib import Path

import torch
from torch import Tensor
from tqdm import tqdm

from model_runtime.errors import UsageError
from model_runtime.model_files.weights import ENCODER
from model_runtime.states import rows_of

from ...ntm import NTMConfig
from ..bench.kept import identity, keep, read_kept
from ..representation.methods import WEIGHTS
from ..synthesis.methods import load_models
from ..synthesis.sphere import TexturedSphere
from ..synthesis.training import Effort, School, describe
from .inputs import INPUTS
from .means import MEANS
from .report import write_report
from .results import MethodResult, StabilityReport
from .runs import Classroom, Outcome
from .sources import SOURCES
from .targets import TARGETS
from .trials import EVERY, Stress, Trial, World

__all__ = ("STRESSES", "evaluate_stability")

STRESSES: Mapping[str, Stress] = {**TARGETS, **INPUTS, **MEANS, **SOURCES}
"""By name."""

_VERSION = 1
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
    names, wanted = tuple(methods or EVERY), tuple(stresses or STRESSES)
    for kind, asked, known in (("method", names, EVERY), ("stress", wanted, tuple(STRESSES))):
        unknown = [name for name in asked if name not in known]
        if unknown:
            raise UsageError(
                f"There is no {kind} '{unknown[0]}'.", f"Choose among {', '.join(known)}."
            )
    start = time.perf_counter()
    kept = output / "kept"
    models = load_models(names, School(kept, effort), encoder=ENCODER, weights=weights)
    sphere = TexturedSphere.load(data / "hdri", pixels=pixels, stride=stride, kept=kept)
    classroom, world = Classroom(models, sphere), World(data, pixels)
    found: dict[str, dict[str, MethodResult]] = {}
    cells = [(name, x) for name in wanted for x in STRESSES[name].severities]
    outcomes: dict[tuple[str, str], dict[float, Outcome]] = {}
    for name, x in tqdm(cells, desc="stresses", unit=" trial"):
        stress = STRESSES[name]
        trial = stress.make(world, x)
        described = _description(trial, f"{pixels} {stride} {effort} {_VERSION}")
        for method in names:
            if method in stress.methods:
                outcome = _kept(kept, identity(described, method), trial, method, classroom)
                outcomes.setdefault((name, method), {})[x] = outcome
    for (name, method), each in outcomes.items():
        found.setdefault(name, {})[method] = MethodResult(each, method == "ours")
    settings = {"pixels": pixels, "stride": stride, "effort": asdict(effort)}
    report = StabilityReport(found, settings, time.perf_counter() - start)
    output.mkdir(parents=True, exist_ok=True)
    write_report(report, STRESSES, output)
    text = json.dumps(report.json(), indent=1)
    (output / "stability.json").write_text(text, encoding="utf-8")
    return report


def _description(trial: Trial, settings: str) -> str:
    """What identifies a trial."""
    parts: list[Tensor | str] = [describe(trial.case.source), describe(trial.case.target), settings]
    if trial.given is not None:
        parts.append(rows_of(trial.given))
    if trial.unscored is not None:
        parts.append(torch.from_numpy(trial.unscored))
    rest = (trial.last_only, trial.span, trial.palette, trial.samples, trial.dtype)
    return identity(*parts, str(rest), "" if trial.killed is None else f"{trial.killed}")


def _kept(kept: Path, made_from: str, trial: Trial, method: str, classroom: Classroom) -> Outcome:
    """From an earlier run, or another stress that is as harmless, or anew."""
    path = kept / f"trial_{made_from[:20]}.safetensors"
    stored = read_kept(path, made_from)
    if stored is None:
        outcome = classroom.run(trial, method)
        said = json.dumps(outcome.said).encode()
        stored = {
            "psnr": torch.tensor(outcome.psnr, dtype=torch.float64),
            "in_gamut": torch.tensor(outcome.in_gamut),
            "said": torch.tensor(list(said), dtype=torch.uint8),
        }
        keep(path, stored, made_from)
    said = json.loads(bytes(stored["said"].tolist()))
    return Outcome(float(stored["psnr"]), bool(stored["in_gamut"]), tuple(said))
