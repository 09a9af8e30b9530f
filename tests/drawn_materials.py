"""A few random materials whose BRDFs are formulas."""

from __future__ import annotations

import torch

from model_runtime.brdf import disney, torrance_sparrow
from training.data.analytic import random_disney, random_torrance_sparrow
from training.evaluation.representation.probes import Group


def drawn(seed: int) -> Group:
    """Three of Disney's and three Torrance-Sparrow materials."""
    g = torch.Generator().manual_seed(seed)
    parameters, states = random_disney(3, g), random_torrance_sparrow(3, g)
    names = tuple("abcdef")
    return Group(
        names,
        lambda angles: torch.cat(
            (
                disney.evaluate(parameters, angles),
                torrance_sparrow.evaluate(*states, angles),
            )
        ),
    )
