"""What varnish does to what lies under it: random walks, and what may stand in for them.

Three laws (`stacks`) and the network of layered latents are held against walks in a few lit views.
`latents` are told of the walks themselves, and so say how near a network can come: those of our
encoder, looked at again as measured materials are. Then what one lobe holds, as a texture has it:
of a law, of what the network says, and of the walks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import fmean

import torch
from torch import Tensor

from model_runtime.brdf.refinement import fit_seen
from model_runtime.brdf.torrance_sparrow import evaluate
from model_runtime.brdf.views import other_views, psnr_of
from model_runtime.channels import optics
from model_runtime.representation import Trained, load_representation
from model_runtime.representation.measured import encode_measured

from ...baselines.layering import Layering, load_layering
from ...data.walks import evaluate_stack
from ..bench import results
from ..bench.encoders import WEIGHTS
from ..bench.results import Result, write_report
from .stacks import (
    GROUNDS,
    Stacks,
    film,
    film_state,
    multiplied,
    refracted,
    under_varnish,
)

__all__ = ("LAWS", "LayersReport", "evaluate_layers", "table")

LAWS = (
    *("multiplied", "film", "refracted", "network", "latents"),
    *("film_lobe", "network_lobe", "walks_lobe"),
)
"""What is held against the walks."""

NETWORK = WEIGHTS / "layering.safetensors"
_AGES = (0.0, 0.5, 1.0)
_ROUGHNESS = (0.05, 0.15)  # alpha: glossy and satin
_WALKS, _SEED = 64, 0


@dataclass(frozen=True)
class Compared(Result):
    """PSNR in dB by each of `LAWS`, of a ground under a film of this alpha at this share of the
    depth.
    """

    JSON = (("ground", None), ("alpha", None), ("age", None), *((name, 1) for name in LAWS))

    ground: str
    alpha: float
    age: float
    multiplied: float
    film: float
    refracted: float
    network: float
    latents: float
    film_lobe: float
    network_lobe: float
    walks_lobe: float


@dataclass(frozen=True)
class LayersReport(Result):
    """A row a stack."""

    JSON = (("rows", None),)

    rows: list[Compared]


def evaluate_layers(
    output: Path,
    *,
    walks: int = _WALKS,
    grounds: Sequence[str] = GROUNDS,
    ages: Sequence[float] = _AGES,
    roughness: Sequence[float] = _ROUGHNESS,
    weights: Path = NETWORK,
) -> LayersReport:
    """All `grounds` under films of all `ages` and alphas, by so many `walks` a pair of directions;
    writes `layers.json` and `.md` to a folder. Raises what `load_layering` does.
    """
    network, (representation, _) = load_layering(weights), load_representation()
    generator = torch.Generator().manual_seed(_SEED)
    rows: list[Compared] = []
    for alpha in roughness:
        for age in ages:
            stacks = under_varnish(alpha, age, grounds)
            found = _compared(stacks, network, representation, walks, generator).T.tolist()
            pairs = zip(grounds, found, strict=True)
            rows += [Compared(ground, alpha, age, *each) for ground, each in pairs]
    report = LayersReport(rows)
    output.mkdir(parents=True, exist_ok=True)
    write_report(output, "layers", [table(report)], report)
    return report


def _compared(
    stacks: Stacks,
    network: Layering,
    representation: Trained,
    walks: int,
    generator: torch.Generator,
) -> Tensor:
    """dB [laws, grounds]."""
    views = other_views()

    @cache  # by identity: what is fitted to walks is held against the same ones as the laws
    def truth(angles: Tensor) -> Tensor:
        return evaluate_stack(stacks.film, stacks.ground, angles, walks=walks, generator=generator)

    stack = network(representation.encode_parameters(stacks.ground.states()), stacks.film)

    def told(angles: Tensor) -> Tensor:
        return representation.decode(stack, angles)

    held = encode_measured(representation, truth).latents
    shown = [each(stacks, views.angles) for each in (multiplied, film, refracted)]
    shown += [representation.decode(each, views.angles) for each in (stack, held)]
    lobes = (film_state(stacks), fit_seen(told).states, fit_seen(truth).states)
    shown += [evaluate(*optics(each), views.angles) for each in lobes]
    seen = views.seen(truth(views.angles))
    return torch.stack([psnr_of(seen, views.seen(each)) for each in shown])


def table(report: LayersReport) -> str:
    """dB of each ground by each law: the mean over films."""
    rows = []
    for ground in dict.fromkeys(row.ground for row in report.rows):
        of_ground = [row for row in report.rows if row.ground == ground]
        found = ([getattr(row, law) for row in of_ground] for law in LAWS)
        rows.append([ground, *(f"{fmean(each):.1f}" for each in found)])
    return results.table(["ground", *(law.replace("_", ", a ") for law in LAWS)], rows)
