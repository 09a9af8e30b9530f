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

from .methods import WEIGHTS, Budget, EncoderMethod, Held, Method, load_methods
from .metric import MAPS, Sphere, psnr, tone_map
from .report import INTERPOLATION, write_report
from .results import Cell, MethodResult, Picture, Point, Report
from .sets import SETS, UNIFORM, Evaluate, Materials, material_sets
from .spheres import draw_interpolation

__all__ = ("SHOWN", "Curve", "evaluate_representation")

SHOWN = MAPS.index("potsdamer_platz")
"""The environment map that pictures are made under."""


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

    PSNR in dB on the metric of DESIGN.md with spheres `pixels` wide. `limit` keeps that many
    uniform materials of each set. What NBRDF learns stays in `output`/nbrdf, for the next call.
    `weights` is the folder of the rivals' trained weights. Raises `UsageError` for methods and sets
    that do not exist, `ModelFileError` for weights that are missing.
    """
    unknown = [name for name in sets if name not in SETS]
    if unknown:
        raise UsageError(f"There is no set '{unknown[0]}'.", f"Choose among {', '.join(SETS)}.")
    start = time.perf_counter()
    loaded = load_methods(
        methods, weights=weights, cache=output / "nbrdf", budget=budget or Budget()
    )
    sphere = Sphere.load(data / "hdri", pixels=pixels)
    results, truth = _score_all(sphere, data, loaded, tuple(sets), limit)
    uniform = tuple(name for name in sets if name in UNIFORM)
    curves = _curves(data, loaded, uniform, curve or Curve())
    results = {name: replace(result, curve=curves[name]) for name, result in results.items()}
    report = Report(results, truth, sphere.inside, time.perf_counter() - start)
    output.mkdir(parents=True, exist_ok=True)
    ours = loaded.get("ours")
    if isinstance(ours, EncoderMethod):
        draw_interpolation(ours.model, sphere, SHOWN, data, output / INTERPOLATION)
    write_report(report, output)
    text = json.dumps(report.json(), indent=1)
    (output / "representation.json").write_text(text, encoding="utf-8")
    return report


def _score_all(
    sphere: Sphere,
    data: Path,
    methods: dict[str, Method],
    wanted: tuple[str, ...],
    limit: int | None,
) -> tuple[dict[str, MethodResult], dict[tuple[str, str], Tensor]]:
    """Every method on every set it applies to, and the pictures of the truth."""
    scores: dict[str, dict[str, dict[str, float]]] = {name: {} for name in methods}
    pictures: dict[str, dict[tuple[str, str], Picture]] = {name: {} for name in methods}
    held: dict[str, list[Held]] = {name: [] for name in methods}
    shown: dict[tuple[str, str], Tensor] = {}
    sets = material_sets(data, sphere.inside, wanted=wanted, limit=limit)
    bar = tqdm([(name, group) for name, groups in sets.items() for group in groups])
    for set_name, materials in bar:
        truth = _render(sphere, materials, materials.evaluate)
        shown |= {(set_name, name): p for name, p in _shown(materials, truth).items()}
        for name, method in methods.items():
            if not method.applies_to(set_name):
                continue
            bar.set_description(f"{set_name}, {name}")
            mine = method.hold(materials)
            held[name].append(mine)
            estimate = _render(sphere, materials, mine.evaluate)
            each = _scores(materials, truth, estimate)
            scores[name].setdefault(set_name, {}).update(each)
            for material, picture in _shown(materials, estimate).items():
                pictures[name][set_name, material] = Picture(picture, each[material])
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


def _render(sphere: Sphere, materials: Materials, evaluate: Evaluate) -> Tensor:
    """Radiance [n, E, P, 3] of uniform materials, [1, E, P, 3] of a frame."""
    if materials.texels is not None:
        return sphere.render_textured(evaluate, materials.texels)
    rows = torch.arange(materials.n)
    return sphere.render(lambda angles: evaluate(rows, angles))


def _scores(materials: Materials, truth: Tensor, estimate: Tensor) -> dict[str, float]:
    """dB by name, averaged over maps."""
    return dict(zip(materials.names, psnr(truth, estimate).mean(1).tolist(), strict=True))


def _shown(materials: Materials, radiance: Tensor) -> dict[str, Tensor]:
    """Tone-mapped pixels [P, 3] by name; half precision, as many are kept."""
    pixels = tone_map(radiance[:, SHOWN]).half()
    return dict(zip(materials.names, pixels, strict=True))


def _curves(
    data: Path, methods: dict[str, Method], sets: tuple[str, ...], curve: Curve
) -> dict[str, tuple[Point, ...]]:
    """Accuracy over time of every method, on a part of the uniform sets."""
    sphere = Sphere.load(data / "hdri", pixels=curve.pixels)
    groups = material_sets(data, sphere.inside, wanted=sets, limit=curve.materials)
    every = [(name, group) for name, parts in groups.items() for group in parts]
    truths = [_render(sphere, group, group.evaluate) for _, group in every]
    curves = {}
    for name, method in methods.items():
        points = []
        for setting in tqdm(method.settings(), desc=f"speed and accuracy, {name}"):
            held: list[Held] = []
            scores: dict[str, dict[str, float]] = {}
            for (set_name, group), truth in zip(every, truths, strict=True):
                if not method.applies_to(set_name):
                    continue
                held.append(method.hold(replace(group, key=f"curve_{group.key}"), setting))
                estimate = _render(sphere, group, held[-1].evaluate)
                scores.setdefault(set_name, {}).update(_scores(group, truth, estimate))
            if held:
                cells = {key: Cell(each) for key, each in scores.items()}
                points.append(Point(*method.point(held, setting), cells))
        curves[name] = tuple(points)
    return curves
