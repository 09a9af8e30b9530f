"""How well representations hold BRDFs: `python -m training evaluate representation`."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor
from tqdm import tqdm

from model_runtime.errors import UsageError

from ...metric.sphere import Sphere
from .methods import WEIGHTS, Budget, EncoderMethod, Held, Method, load_methods
from .properties import measure_properties
from .report import INTERPOLATION, write_report
from .results import Cell, MethodResult, Picture, Point, Report
from .scoring import SHOWN, score, show, truth
from .sets import SETS, UNIFORM, Materials, material_sets
from .spheres import draw_interpolation

__all__ = ("Curve", "evaluate_representation")


@dataclass(frozen=True)
class Curve:
    """What the chart of accuracy over time is made from: some materials of every uniform set, on
    smaller spheres.
    """

    materials: int = 12
    pixels: int = 16


@torch.no_grad()
def evaluate_representation(
    data: Path,
    output: Path,
    *,
    pixels: int = 64,
    methods: Sequence[str] | None = None,
    sets: Sequence[str] = SETS,
    limit: int | None = None,
    budget: Budget | None = None,
    curve: Curve | None = None,
    weights: Path = WEIGHTS,
) -> Report:
    """Score `methods` (default: all) on `sets`; write `representation.json`, `.md` and pictures to
    `output`.

    PSNR in dB on the metric of docs/design.md with spheres `pixels` wide. `limit` keeps that many
    uniform materials of each set. What NBRDF learns and what has been rendered stays in
    `output`/kept, so that the next call, or one after an interruption, is quick. `weights` is the
    folder of the rivals' trained weights. Raises `UsageError` for methods and sets that do not
    exist, `ModelFileError` for weights that are missing.
    """
    unknown = [name for name in sets if name not in SETS]
    if unknown:
        raise UsageError(f"There is no set '{unknown[0]}'.", f"Choose among {', '.join(SETS)}.")
    start = time.perf_counter()
    kept = output / "kept"
    loaded = load_methods(methods, weights=weights, cache=kept, budget=budget or Budget())
    sphere = Sphere.load(data / "hdri", pixels=pixels)
    materials = material_sets(data, sphere.inside, wanted=tuple(sets), limit=limit)
    results, true_pictures = _score_all(sphere, materials, loaded, kept)
    curve = curve or Curve()
    small = Sphere.load(data / "hdri", pixels=curve.pixels)
    uniform = tuple(name for name in sets if name in UNIFORM)
    some = material_sets(data, small.inside, wanted=uniform, limit=curve.materials)
    curves = _curves(small, some, loaded, kept)
    for name, result in results.items():
        result = replace(result, curve=curves[name])
        method = loaded[name]
        if isinstance(method, EncoderMethod):
            result = replace(
                result,
                progress=tuple(method.trained.get("curve", ())),
                properties=measure_properties(method.model, data, pixels=curve.pixels),
            )
        results[name] = result
    report = Report(results, true_pictures, sphere.inside, time.perf_counter() - start)
    output.mkdir(parents=True, exist_ok=True)
    ours = loaded.get("ours")
    if isinstance(ours, EncoderMethod):
        draw_interpolation(ours.model, sphere, SHOWN, data, output / INTERPOLATION)
    write_report(report, output)
    text = json.dumps(report.json(), indent=1)
    (output / "representation.json").write_text(text, encoding="utf-8")
    return report


def _score_all(
    sphere: Sphere, sets: dict[str, list[Materials]], methods: dict[str, Method], kept: Path
) -> tuple[dict[str, MethodResult], dict[tuple[str, str], Tensor]]:
    """Every method on every set it applies to, and the pictures of the truth."""
    scores: dict[str, dict[str, dict[str, float]]] = {name: {} for name in methods}
    pictures: dict[str, dict[tuple[str, str], Picture]] = {name: {} for name in methods}
    held: dict[str, list[Held]] = {name: [] for name in methods}
    shown: dict[tuple[str, str], Tensor] = {}
    bar = tqdm([(name, group) for name, groups in sets.items() for group in groups])
    for set_name, materials in bar:
        radiance = truth(sphere, materials)
        shown |= {(set_name, name): p for name, p in show(materials, radiance).items()}
        for name, method in methods.items():
            if not method.applies_to(set_name):
                continue
            bar.set_description(f"{set_name}, {name}")
            mine = method.hold(materials)
            held[name].append(mine)
            path = kept / f"{name}_{materials.key}.safetensors"
            outcome = score(sphere, materials, radiance, mine.evaluate, path)
            scores[name].setdefault(set_name, {}).update(outcome.scores)
            for material, picture in outcome.pictures.items():
                pictures[name][set_name, material] = Picture(picture, outcome.scores[material])
    results = {
        name: MethodResult(
            cells={key: Cell(each) for key, each in scores[name].items()},
            cost=method.cost(held[name]),
            curve=(),
            pictures=pictures[name],
        )
        for name, method in methods.items()
        if held[name]
    }
    return results, shown


def _curves(
    sphere: Sphere, sets: dict[str, list[Materials]], methods: dict[str, Method], kept: Path
) -> dict[str, tuple[Point, ...]]:
    """Accuracy over time of every method."""
    every = [
        (name, replace(group, key=f"curve_{group.key}"), truth(sphere, group))
        for name, groups in sets.items()
        for group in groups
    ]
    curves = {}
    for name, method in methods.items():
        points = []
        for setting in tqdm(method.settings(), desc=f"speed and accuracy, {name}"):
            held: list[Held] = []
            scores: dict[str, dict[str, float]] = {}
            for set_name, group, radiance in every:
                if not method.applies_to(set_name):
                    continue
                held.append(method.hold(group, setting))
                tag = f"{name}_{group.key}_{setting.samples}_{setting.effort:g}"
                path = kept / f"{tag}.safetensors"
                outcome = score(sphere, group, radiance, held[-1].evaluate, path)
                scores.setdefault(set_name, {}).update(outcome.scores)
            if held:
                cells = {key: Cell(each) for key, each in scores.items()}
                points.append(Point(*method.point(held, setting), cells))
        curves[name] = tuple(points)
    return curves
