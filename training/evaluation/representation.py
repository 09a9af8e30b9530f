"""How well representations hold BRDFs: `python -m training evaluate representation`."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from model_runtime.brdf import disney, rgl, torrance_sparrow
from model_runtime.package import ENCODER, read_card
from model_runtime.representation import load_representation
from model_runtime.representation.latents import Representation

from ..data.analytic import random_disney, random_torrance_sparrow
from ..data.nbrdf import HELD_OUT, NeuralBRDFs, load
from .metric import Sphere, psnr

__all__ = ("evaluate_representation", "material_sets")

_SEED = 20240715
_TOGETHER = 25


@dataclass(frozen=True)
class MaterialSet:
    """Named materials that are evaluated together: `evaluate`(angles [M, 3]) -> f [n, M, 3]."""

    names: tuple[str, ...]
    evaluate: Callable[[Tensor], Tensor]


def material_sets(data: Path) -> dict[str, list[MaterialSet]]:
    """The sets of the report, each in groups small enough to be held in memory at once.

    No bundled encoder was trained on `merl_held_out`, `rgl`, `bsdf` or these draws of `disney` and
    `torrance_sparrow`. For MERL and RGL the truth is what Neural-BRDF's networks say.
    """
    merl, isotropic = load(data, "merl"), load(data, "rgl-isotropic")
    g = torch.Generator().manual_seed(_SEED)
    sets: dict[str, list[MaterialSet]] = {
        "merl_seen": _networks(merl.without(HELD_OUT)),
        "merl_held_out": _networks(merl.select(list(HELD_OUT))),
        "rgl": _networks(isotropic),
        "bsdf": [_measured(path) for path in sorted((data / "bsdf").glob("*.bsdf"))],
        "disney": [],
        "torrance_sparrow": [],
    }
    for group in range(100 // _TOGETHER):
        names = tuple(str(group * _TOGETHER + i) for i in range(_TOGETHER))
        parameters = random_disney(_TOGETHER, g)
        states = random_torrance_sparrow(_TOGETHER, g)
        sets["disney"].append(
            MaterialSet(names, lambda angles, p=parameters: disney.evaluate(p, angles))
        )
        sets["torrance_sparrow"].append(
            MaterialSet(names, lambda angles, s=states: torrance_sparrow.evaluate(*s, angles))
        )
    return sets


def _networks(networks: NeuralBRDFs) -> list[MaterialSet]:
    rows = torch.arange(len(networks)).split(_TOGETHER)
    return [
        MaterialSet(
            tuple(networks.names[i] for i in part),
            lambda angles, part=part: networks.evaluate(part, angles),
        )
        for part in rows
    ]


def _measured(path: Path) -> MaterialSet:
    brdf = rgl.read(path)
    return MaterialSet((brdf.name,), lambda angles: brdf.evaluate(angles)[None])


@torch.no_grad()
def evaluate_representation(
    data: Path, output: Path, *, pixels: int = 64, encoder: Path = ENCODER
) -> dict[str, Any]:
    """Score the bundled representation on every set and write `representation.json` to `output`.

    PSNR in dB on the metric of DESIGN.md with a sphere `pixels` wide: mean, min, p5 and n of each
    set, and of every material; with the size, the cost and the training of the method.
    """
    sphere = Sphere.load(data / "hdri", pixels=pixels)
    model, _ = load_representation(encoder)
    sets: dict[str, Any] = {}
    for name, groups in material_sets(data).items():
        each: dict[str, float] = {}
        for group in tqdm(groups, desc=name):
            each |= dict(zip(group.names, _scores(sphere, model, group), strict=True))
        values = np.array(list(each.values()))
        sets[name] = {
            "mean": round(float(values.mean()), 2),
            "min": round(float(values.min()), 2),
            "p5": round(float(np.quantile(values, 0.05)), 2),
            "n": len(values),
            "materials": {key: round(value, 2) for key, value in each.items()},
        }
    trained = read_card(encoder).trained
    report = {
        "metric": {"pixels": pixels, "seed": _SEED},
        "methods": {
            "ours": {
                "sets": sets,
                "parameters": sum(p.numel() for p in model.parameters()),
                "latent_dims": sum(model.latent_sizes),
                **_cost(model),
                "train_minutes": trained.get("minutes"),
                "train_iterations": trained.get("iterations"),
            }
        },
    }
    output.mkdir(parents=True, exist_ok=True)
    (output / "representation.json").write_text(json.dumps(report, indent=1), encoding="utf-8")
    return report


def _scores(sphere: Sphere, model: Representation, group: MaterialSet) -> list[float]:
    angles = model.sample_angles(1024)
    latents = model.encode(angles, group.evaluate(angles))
    truth = sphere.render(group.evaluate, chunk=4)
    estimate = sphere.render(lambda wanted: model.decode(latents, wanted), chunk=4)
    return psnr(truth, estimate).mean(1).tolist()


def _cost(model: Representation) -> dict[str, float]:
    """Milliseconds to encode a BRDF, microseconds to decode a sample; one core, in batches."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    angles = model.sample_angles(1024)
    f = torch.rand(64, len(angles), 3)
    wanted = angles[:256]

    def seconds(call: Callable[[], object]) -> float:
        call()
        start = time.perf_counter()
        for _ in range(5):
            call()
        return (time.perf_counter() - start) / 5 / len(f)

    latents = model.encode(angles, f)
    cost = {
        "encode_ms": round(1e3 * seconds(lambda: model.encode(angles, f)), 4),
        "decode_us_per_sample": round(
            1e6 * seconds(lambda: model.decode(latents, wanted)) / len(wanted), 4
        ),
    }
    torch.set_num_threads(threads)
    return cost
