"""The short cut from Torrance-Sparrow parameters to latents, learned from a trained encoder."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from model_runtime.brdf import torrance_sparrow
from model_runtime.channels import ALPHA_MIN, WIDTH, optics
from model_runtime.model_files.weights import hash_tensors
from model_runtime.representation.lobes import LobeRepresentation
from model_runtime.states import joined

from .data.analytic import random_torrance_sparrow
from .distributed import exactly
from .loop import Run, Schedule, Training, train

__all__ = ("SHORT_CUT", "distil", "random_states")

SHORT_CUT = "short_cut"
"""The part of a run in which it is learned."""

_BATCH = 256
_SCHEDULE = Schedule(2e-3, warm_up=100)


def random_states(n: int, g: torch.Generator) -> Tensor:
    """States [n, C]: half what textures hold, half anything, albedos up to 1.3 and alpha
    down to 1e-4.
    """
    textures = joined(*random_torrance_sparrow(n // 2, g))
    u = torch.rand(n - n // 2, WIDTH, generator=g)
    kd, ks, alpha = optics(u)
    anything = joined(kd.square() * 1.3, ks.square() * 1.3, ALPHA_MIN**alpha)
    return torch.cat((textures, anything))


def distil(model: LobeRepresentation, run: Run, *, iterations: int) -> None:
    """Train `model.encode_parameters` to give what `model.encode` gives; changes nothing else.

    It is a part of `run`, with a checkpoint of its own.
    """
    g = torch.Generator().manual_seed(run.seed)
    mine = run.world.share(_BATCH)
    angles = model.sample_angles(len(model.encoder_angles))
    layers = nn.ModuleList((model.from_channel, model.from_pooled, model.from_each))
    made_from = {"encoder": hash_tensors(model.state_dict())}

    def loss(_: int) -> Tensor:
        states = mine(random_states(_BATCH, g))
        with torch.no_grad(), exactly():
            wanted = model.encode(angles, torrance_sparrow.evaluate(*optics(states), angles)).flat()
        missed = (model.encode_parameters(states).flat() - wanted).abs().mean()
        return mine.weight * missed

    training = Training(layers, loss, _SCHEDULE, iterations, g, made_from, clip=None)
    train(training, replace(run.part(SHORT_CUT), minutes=None))
