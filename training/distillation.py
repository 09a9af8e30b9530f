"""The short cut from Torrance-Sparrow parameters to latents, learned from a trained encoder."""

from __future__ import annotations

import torch
from torch import Tensor
from tqdm import tqdm

from model_runtime.brdf import torrance_sparrow
from model_runtime.representation.lobes import LobeRepresentation

from .data.analytic import random_torrance_sparrow
from .loop import Schedule, adam, optimise

__all__ = ("distil", "random_states")

_BATCH = 256
_SCHEDULE = Schedule(2e-3, warm_up=100)


def random_states(n: int, g: torch.Generator) -> Tensor:
    """[n, 7] = (kd, ks, alpha): half what textures hold, half anything, albedos up to 1.3 and alpha
    down to 1e-4.
    """
    kd, ks, alpha = random_torrance_sparrow(n // 2, g)
    u = torch.rand(n - n // 2, 7, generator=g)
    anything = torch.cat((u[:, :6].square() * 1.3, 1e-4 ** u[:, 6:]), 1)
    return torch.cat((torch.cat((kd, ks, alpha[:, None]), 1), anything))


def distil(model: LobeRepresentation, *, seed: int, iterations: int) -> None:
    """Train `model.encode_parameters` to give what `model.encode` gives; changes nothing else."""
    g = torch.Generator().manual_seed(seed)
    angles = model.sample_angles(len(model.encoder_angles))
    layers = (model.from_channel, model.from_pooled, model.from_each)

    def loss(_: int) -> Tensor:
        states = random_states(_BATCH, g)
        kd, ks, alpha = states[:, :3], states[:, 3:6], states[:, 6]
        with torch.no_grad():
            wanted = model.encode(angles, torrance_sparrow.evaluate(kd, ks, alpha, angles)).flat()
        return (model.encode_parameters(states).flat() - wanted).abs().mean()

    weights = (weight for layer in layers for weight in layer.parameters())
    steps = tqdm(range(iterations), desc="parameters to latents")
    optimise(loss, adam(weights), _SCHEDULE, steps, iterations)
