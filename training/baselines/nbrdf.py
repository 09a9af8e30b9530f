"""NBRDF: one small network a material, fitted to its samples.

A. Sztrajman, G. Rainer, T. Ritschel, T. Weyrich: Neural BRDF Representation and Importance
Sampling. Computer Graphics Forum 40(6), 2021. The rival that knows nothing beforehand: where an
encoder is trained once and then reads a material in a millisecond, this trains for every one.
All networks of a call are trained side by side, which a CPU does many times faster than one by one.
"""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from model_runtime.brdf.half_angle import cosines

from ..evaluation.bench.kept import identity, kept
from ..loop import Schedule, optimize

__all__ = ("Networks", "Training", "cached_fit", "fit", "vectors")

_SIZES = (6, 21, 21, 3)
PARAMETERS = sum((inputs + 1) * outputs for inputs, outputs in itertools.pairwise(_SIZES))
_LARGEST = math.log1p(1e4)


@dataclass(frozen=True)
class Training:
    """How long and how fast every network learns; the same random samples serve all of them."""

    iterations: int = 3000
    batch: int = 256
    learning_rate: float = 1e-2
    seed: int = 0


@dataclass(frozen=True)
class Networks:
    """n networks 6 -> 21 -> 21 -> 3: `layers` holds a weight [n, in, out] and a bias [n, 1, out]
    each. `seconds` of one core is what training them took, all together.
    """

    layers: tuple[tuple[Tensor, Tensor], ...]
    seconds: float

    def __len__(self) -> int:
        return len(self.layers[0][0])

    def evaluate(self, rows: Tensor, angles: Tensor) -> Tensor:
        """f per steradian of networks `rows` [N] at `angles` [M, 3]: [N, M, 3].

        What the network says, at least 0; nothing is averaged over the two directions of light.
        """
        layers = tuple((weight[rows], bias[rows]) for weight, bias in self.layers)
        x = vectors(angles).expand(len(rows), -1, -1)
        return torch.expm1(_logarithm(layers, x)).clamp_min(0)


def vectors(angles: Tensor) -> Tensor:
    """The half and the difference vector of `angles` [M, 3], side by side: [M, 6]."""
    theta_h, theta_d, phi_d = angles.unbind(-1)
    sin_d = theta_d.sin()
    half = (theta_h.sin(), torch.zeros_like(theta_h), theta_h.cos())
    return torch.stack((*half, sin_d * phi_d.cos(), sin_d * phi_d.sin(), theta_d.cos()), -1)


def _logarithm(layers: tuple[tuple[Tensor, Tensor], ...], x: Tensor) -> Tensor:
    """log(1 + f), as the last layer gives it: [n, M, 3] for inputs `x` [n, M, 6]."""
    *hidden, last = layers
    for weight, bias in hidden:
        x = torch.baddbmm(bias, x, weight).relu_()
    return torch.baddbmm(last[1], x, last[0]).clamp_max(_LARGEST)


def _initial(n: int, g: torch.Generator) -> tuple[tuple[Tensor, Tensor], ...]:
    """The same start for every network, so that a network does not depend on its neighbors."""
    layers = []
    for inputs, outputs in itertools.pairwise(_SIZES):
        reach = math.sqrt(3 / inputs)
        weight = (torch.rand(inputs, outputs, generator=g) * 2 - 1) * reach
        layers.append((weight.repeat(n, 1, 1), torch.zeros(n, 1, outputs)))
    return tuple(layers)


def fit(angles: Tensor, f: Tensor, training: Training = Training()) -> Networks:
    """Train a network for each of n materials with values `f` [n, M, 3] at `angles` [M, 3].

    The loss is the published one, mean |log(1 + f cos_i) - log(1 + f_hat cos_i)|; Adam with a
    cosine to nothing, so that short trainings end well. The maximum with 0 is taken only in
    `Networks.evaluate`: a network that begins below it would otherwise never learn.
    """
    g = torch.Generator().manual_seed(training.seed)
    layers = _initial(len(f), g)
    parameters = [tensor.requires_grad_() for layer in layers for tensor in layer]
    optimizer = torch.optim.Adam(parameters, fused=True)
    cos_i = cosines(angles)[0].clamp_min(0)[:, None]
    target = torch.log1p(f.clamp_min(0) * cos_i)
    x = vectors(angles)

    def loss(_: int) -> Tensor:
        drawn = torch.randint(len(angles), (training.batch,), generator=g)
        estimate = torch.expm1(_logarithm(layers, x[drawn].expand(len(f), -1, -1)))
        shaded = torch.log1p((estimate * cos_i[drawn]).clamp_min(-0.9))
        return (shaded - target[:, drawn]).abs().sum(0).mean()

    schedule = Schedule(training.learning_rate, floor=0.0)
    start, steps = time.process_time(), training.iterations
    optimize(loss, optimizer, schedule, range(steps), steps)
    trained = tuple((weight.detach(), bias.detach()) for weight, bias in layers)
    return Networks(trained, time.process_time() - start)


def cached_fit(path: Path, angles: Tensor, f: Tensor, training: Training = Training()) -> Networks:
    """`fit`, or the networks that an earlier call left at `path` for the same samples and training.

    A file that is missing, damaged or made from anything else is replaced.
    """

    def make() -> dict[str, Tensor]:
        networks = fit(angles, f, training)
        tensors = {"seconds": torch.tensor(networks.seconds)}
        for i, (weight, bias) in enumerate(networks.layers):
            tensors |= {f"weight{i}": weight, f"bias{i}": bias}
        return tensors

    found = kept(path, identity(repr(training), angles, f), make)
    layers = tuple((found[f"weight{i}"], found[f"bias{i}"]) for i in range(len(_SIZES) - 1))
    return Networks(layers, found["seconds"].item())
