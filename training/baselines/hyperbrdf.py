"""HyperBRDF: samples in any number and order become the weights of a small network, the BRDF.

F. Gokbudak, A. Sztrajman, C. Zhou, F. Zhong, R. Mantiuk, C. Oztireli: Hypernetworks for
Generalizable BRDF Representation. ECCV 2024. Written from its idea: every sample passes one
network, the mean over samples is the latent, and a network a layer turns that into the weights of a
field of half and difference vectors, as NBRDF's are, at which any direction is looked up.
"""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor, nn

from model_runtime.brdf import torrance_sparrow
from model_runtime.channels import optics
from model_runtime.representation.latents import PAPER_SAMPLES, Latents
from model_runtime.representation.lobes import compress, expand, mlp
from model_runtime.representation.paper import PaperRepresentation

from .nbrdf import vectors

__all__ = ("HyperBRDF",)

_LATENTS = 40
_WIDTH = 128
_FIELD = (6, 60, 60, 3)
_PARAMETRIC_SAMPLES = 256
_SCALE = 5.0
"""Compressed reflectances are about so large."""

_LARGEST = 16.2


class HyperBRDF(nn.Module):
    """See the module's description. All latents are shared: it knows no colors apart."""

    name = "hyperbrdf"

    directions: Tensor

    def __init__(self) -> None:
        super().__init__()
        directions = PaperRepresentation().sample_angles(PAPER_SAMPLES)
        self.register_buffer("directions", directions, persistent=False)
        self.each_sample = mlp(_FIELD[0] + 3, _WIDTH, _WIDTH, _WIDTH, _LATENTS)
        layers = [
            mlp(_LATENTS, _WIDTH, (inputs + 1) * outputs)
            for inputs, outputs in itertools.pairwise(_FIELD)
        ]
        for layer, inputs in zip(layers, _FIELD, strict=False):
            _start_as_a_network(layer, inputs)
        self.to_layers = nn.ModuleList(layers)

    @property
    def latent_sizes(self) -> tuple[int, int]:
        """Numbers for the three channels together, and shared ones."""
        return 0, _LATENTS

    def sample_angles(self, m: int, *, measured: bool = False) -> Tensor:
        """The first `m` of the directions [m, 3] that the paper's encoder reads."""
        return self.directions[:m]

    def encode(self, angles: Tensor, f: Tensor) -> Latents:
        """Latents of `f` [N, M, 3] at any `angles` [M, 3]."""
        values = compress(f.clamp(0, 1e5)) / _SCALE
        placed = vectors(angles).expand(len(f), -1, -1)
        latent = self.each_sample(torch.cat((placed, values), 2)).mean(1)
        return Latents(f.new_zeros(len(f), 3, 0), latent)

    def encode_parameters(self, states: Tensor) -> Latents:
        """Latents of Torrance-Sparrow materials `states` [N, C], sampled."""
        angles = self.sample_angles(_PARAMETRIC_SAMPLES)
        return self.encode(angles, torrance_sparrow.evaluate(*optics(states), angles))

    def decode(self, latents: Latents, angles: Tensor) -> Tensor:
        """f [N, M, 3] at `angles` [M, 3]; below 0 only in training, which would not find back from
        a flat 0.
        """
        x = vectors(angles).expand(len(latents.shared), -1, -1)
        for i, to_layer in enumerate(self.to_layers):
            weights = to_layer(latents.shared).unflatten(1, (_FIELD[i] + 1, -1))
            x = torch.baddbmm(weights[:, -1:], x.relu() if i else x, weights[:, :-1])
        return expand((x * _SCALE).clamp(-5 if self.training else 0, _LARGEST))


def _start_as_a_network(to_layer: nn.Sequential, inputs: int) -> None:
    """Let `to_layer` give every latent nearly the same weights at first, of the size that ReLUs
    ask for.
    """
    last = to_layer[-1]
    assert isinstance(last, nn.Linear)
    with torch.no_grad():
        last.weight.mul_(0.1)
        weights = last.bias.view(inputs + 1, -1)
        nn.init.normal_(weights[:-1], std=math.sqrt(2 / inputs))
        nn.init.zeros_(weights[-1])
