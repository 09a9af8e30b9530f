"""The materials on which the properties of representations are measured, always the same."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from model_runtime.brdf import disney, torrance_sparrow
from model_runtime.representation.latents import Latents

from ...baselines.encoders import Encoder
from ...data.analytic import random_disney, random_torrance_sparrow
from ...data.nbrdf import HELD_OUT, NeuralBRDFs, load

__all__ = (
    "SAMPLES",
    "SEED",
    "Group",
    "analytic_groups",
    "measured_groups",
    "reflecting",
    "together",
)

SAMPLES = 1024
"""Directions offered to an encoder; ours reads its 258."""

SEED = 20240715


Evaluate = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class Group:
    """Named materials of one kind: `evaluate`(angles [M, 3]) -> f [n, M, 3]."""

    names: tuple[str, ...]
    evaluate: Evaluate
    measured: bool = False

    def first(self, n: int) -> Group:
        """The first `n` of them."""
        return Group(self.names[:n], lambda angles: self.evaluate(angles)[:n], self.measured)

    def encoded(self, model: Encoder) -> Latents:
        """Latents of all, from undamaged samples."""
        angles = model.sample_angles(SAMPLES, measured=self.measured)
        return model.encode(angles, self.evaluate(angles))


def reflecting(names: tuple[str, ...], *state: Tensor) -> Group:
    kd, ks, alpha = state
    return Group(names, lambda angles: torrance_sparrow.evaluate(kd, ks, alpha, angles))


def analytic_groups() -> dict[str, Group]:
    """Disney, Torrance-Sparrow, mirrors (alpha 1e-3 to 1), albedos above 1, and black."""
    g = torch.Generator().manual_seed(SEED)
    parameters = random_disney(12, g)
    numbers = tuple(str(i) for i in range(12))
    alphas = torch.tensor((1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1.0))
    gold, gray = torch.tensor((0.9, 0.6, 0.3)), torch.full((3,), 0.04)
    paint = torch.tensor((0.1, 0.2, 0.7))
    mirrors = (
        torch.cat((torch.zeros(7, 3), paint.expand(7, 3))),
        torch.cat((gold.expand(7, 3), gray.expand(7, 3))),
        alphas.repeat(2),
    )
    bright = (
        torch.tensor([[1.5, 1.2, 1.0], [0.8, 0.8, 0.8], [0.0, 0.0, 0.0]]),
        torch.tensor([[0.3, 0.3, 0.3], [1.2, 1.0, 0.8], [2.0, 1.5, 1.0]]),
        torch.tensor([0.3, 0.1, 0.02]),
    )
    return {
        "disney": Group(numbers, lambda angles: disney.evaluate(parameters, angles)),
        "torrance_sparrow": reflecting(numbers, *random_torrance_sparrow(12, g)),
        "mirrors": reflecting(
            tuple(f"{kind} {a:g}" for kind in ("gold", "paint") for a in alphas.tolist()), *mirrors
        ),
        "bright": reflecting(("kd 1.5", "kd .8 ks 1.2", "ks 2"), *bright),
        "black": reflecting(("black",), torch.zeros(1, 3), torch.zeros(1, 3), torch.tensor([0.5])),
    }


def measured_groups(data: Path) -> dict[str, Group]:
    """MERL's held-out materials and nine of RGL's, none of which an encoder was trained on."""
    merl, rgl = load(data, "merl"), load(data, "rgl-isotropic")
    few = [name for name in rgl.names if name != "chm_orange_rgb"]
    few = [few[round(i)] for i in torch.linspace(0, len(few) - 1, 9).tolist()]

    def networks(some: NeuralBRDFs) -> Group:
        rows = torch.arange(len(some))
        return Group(some.names, lambda angles: some.evaluate(rows, angles), measured=True)

    return {
        "merl_held_out": networks(merl.select(list(HELD_OUT))),
        "rgl": networks(rgl.select(few)),
    }


def together(groups: Mapping[str, Group]) -> Group:
    """One group of everything."""
    names = tuple(f"{kind}: {name}" for kind, group in groups.items() for name in group.names)
    return Group(names, lambda a: torch.cat([group.evaluate(a) for group in groups.values()]))
