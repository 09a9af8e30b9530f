"""How well representations hold BRDFs: `python -m training evaluate representation`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor
from tqdm import tqdm

from model_runtime.representation.paper import PaperRepresentation

from ...metric.sphere import Sphere, psnr
from ..bench.encoders import WEIGHTS
from ..bench.kept import identity, kept
from ..bench.results import chosen, write_report
from ..bench.spheres import picture
from .methods import Budget, EncoderMethod, Held, Method, load_methods
from .pictures import draw_interpolation
from .properties import measure_properties
from .report import INTERPOLATION, page
from .results import Cell, MethodResult, Picture, Point, Report
from .sets import SETS, UNIFORM, Evaluate, Materials, material_sets

__all__ = ("Curve", "evaluate_representation", "score", "truth")

_PROBES = 64


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
    sets = chosen("set", sets, SETS)
    start = time.perf_counter()
    folder = output / "kept"
    loaded = load_methods(methods, weights=weights, cache=folder, budget=budget or Budget())
    sphere = Sphere.load(data / "hdri", pixels=pixels)
    materials = material_sets(data, sphere.inside, wanted=tuple(sets), limit=limit)
    results, true_pictures = _score_all(sphere, materials, loaded, folder)
    curve = curve or Curve()
    small = Sphere.load(data / "hdri", pixels=curve.pixels)
    uniform = tuple(name for name in sets if name in UNIFORM)
    some = material_sets(data, small.inside, wanted=uniform, limit=curve.materials)
    curves = _curves(small, some, loaded, folder)
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
        draw_interpolation(ours.model, sphere, data, output / INTERPOLATION)
    write_report(output, "representation", page(report, output), report)
    return report


def truth(sphere: Sphere, materials: Materials) -> Tensor:
    """Radiance [n, E, P, 3] of uniform materials, [1, E, P, 3] of a frame."""
    return _render(sphere, materials, materials.evaluate)


def _render(sphere: Sphere, materials: Materials, evaluate: Evaluate) -> Tensor:
    if materials.texels is not None:
        return sphere.render_textured(evaluate, materials.texels)
    rows = torch.arange(materials.n)
    return sphere.render(lambda angles: evaluate(rows, angles))


def score(
    sphere: Sphere, materials: Materials, radiance: Tensor, evaluate: Evaluate, path: Path
) -> dict[str, Picture]:
    """Compare what `evaluate` makes of `materials` with their true `radiance`, by name.

    The outcome is kept at `path` and read there as long as the truth and the values that `evaluate`
    gives at a few directions are the same to the bit: rendering is what takes long.
    """

    def make() -> dict[str, Tensor]:
        estimate = _render(sphere, materials, evaluate)
        return {"scores": psnr(radiance, estimate).mean(1), "pictures": picture(estimate)}

    angles = PaperRepresentation().sample_angles(_PROBES)
    made_from = identity(radiance, evaluate(torch.arange(materials.n), angles))
    found = kept(path, made_from, make)
    pictures = map(Picture, found["pictures"], found["scores"].tolist())
    return dict(zip(materials.names, pictures, strict=True))


def _scores(found: dict[str, Picture]) -> dict[str, float]:
    return {name: each.score for name, each in found.items()}


def _score_all(
    sphere: Sphere, sets: dict[str, list[Materials]], methods: dict[str, Method], folder: Path
) -> tuple[dict[str, MethodResult], dict[tuple[str, str], Tensor]]:
    """Every method on every set it applies to, and the pictures of the truth."""
    scores: dict[str, dict[str, dict[str, float]]] = {name: {} for name in methods}
    pictures: dict[str, dict[tuple[str, str], Picture]] = {name: {} for name in methods}
    held: dict[str, list[Held]] = {name: [] for name in methods}
    shown: dict[tuple[str, str], Tensor] = {}
    bar = tqdm([(name, group) for name, groups in sets.items() for group in groups])
    for set_name, materials in bar:
        radiance = truth(sphere, materials)
        true = zip(materials.names, picture(radiance), strict=True)
        shown |= {(set_name, name): pixels for name, pixels in true}
        for name, method in methods.items():
            if not method.applies_to(set_name):
                continue
            bar.set_description(f"{set_name}, {name}")
            mine = method.hold(materials)
            held[name].append(mine)
            path = folder / f"{name}_{materials.key}.safetensors"
            found = score(sphere, materials, radiance, mine.evaluate, path)
            scores[name].setdefault(set_name, {}).update(_scores(found))
            pictures[name] |= {(set_name, material): each for material, each in found.items()}
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
    sphere: Sphere, sets: dict[str, list[Materials]], methods: dict[str, Method], folder: Path
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
                path = folder / f"{tag}.safetensors"
                found = score(sphere, group, radiance, held[-1].evaluate, path)
                scores.setdefault(set_name, {}).update(_scores(found))
            if held:
                cells = {key: Cell(each) for key, each in scores.items()}
                points.append(Point(*method.point(held, setting), cells))
        curves[name] = tuple(points)
    return curves
