"""Endless random materials to train an encoder on: measured ones, bent and mixed, and analytic
ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from model_runtime.brdf import disney
from model_runtime.brdf import torrance_sparrow as ts
from model_runtime.brdf.half_angle import above_horizon, from_directions

from .analytic import random_disney, random_torrance_sparrow
from .nbrdf import NeuralBRDFs

__all__ = ("draw_batch", "loss_angles", "sphere_angles")

Evaluate = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class _BentMeasured:
    """n measured materials, each a mixture of two, made sharper or blunter, recoloured, faded.

    95 measured materials are few: an encoder trained on them alone stops gaining on unseen ones
    after a third of a run. Mixtures, a stretch of theta_h (a change of roughness), a channel matrix
    and an added diffuse part are materials that might have been measured as well.
    """

    source: NeuralBRDFs
    first: Tensor
    second: Tensor
    share: Tensor
    stretch: Tensor
    recolor: Tensor
    diffuse: Tensor

    @classmethod
    def draw(cls, source: NeuralBRDFs, n: int, plain: float, g: torch.Generator) -> _BentMeasured:
        def uniform(*shape: int) -> Tensor:
            return torch.rand(n, *shape, generator=g)

        def some(probability: float) -> Tensor:
            return (uniform(1) < probability) & ~untouched

        untouched = uniform(1) < plain
        first, second = (torch.randint(len(source), (n,), generator=g) for _ in range(2))
        share = torch.where(some(0.4), uniform(1), torch.zeros(n, 1))
        stretch = torch.where(some(0.6), (uniform(1) * 1.4 - 0.7).exp(), torch.ones(n, 1))
        gains = torch.randn(n, 3, generator=g).mul(0.4).exp() * (
            torch.randn(n, 1, generator=g).mul(0.5).exp()
        )
        blend = uniform(1, 1) * 0.5
        matrix = torch.diag_embed(gains) * (1 - blend) + gains[:, :, None] * blend / 3
        recolor = torch.where(some(0.6)[..., None], matrix, torch.eye(3))
        diffuse = torch.where(some(0.25), uniform(3) * uniform(1) / math.pi, torch.zeros(n, 3))
        return cls(source, first, second, share, stretch, recolor, diffuse)

    def __call__(self, angles: Tensor) -> Tensor:
        theta_h = angles[:, 0] * self.stretch
        # the directions stay where they are; only the lobe is looked up elsewhere
        bent = angles.expand(len(theta_h), -1, -1).clone()
        bent[..., 0] = torch.minimum(theta_h, 0.5 * (theta_h + math.pi / 2)).clamp_max(1.5)
        inside = above_horizon(bent)
        bent[..., 0] = torch.where(inside, bent[..., 0], angles[:, 0].expand_as(theta_h))
        f = self.source.evaluate(self.first, bent)
        mixed = (self.share[:, 0] > 0).nonzero()[:, 0]
        if len(mixed):
            other = self.source.evaluate(self.second[mixed], bent[mixed])
            f[mixed] = torch.lerp(f[mixed], other, self.share[mixed][..., None])
        return torch.einsum("ncd,nmd->nmc", self.recolor, f) + self.diffuse[:, None]


def draw_batch(
    measured: NeuralBRDFs, size: int, g: torch.Generator, *, bent: float, torrance_sparrow: float
) -> list[Evaluate]:
    """Functions of angles [M, 3] -> f [n, M, 3] that make up `size` materials.

    Half are measured (a share `bent` of them changed), a share `torrance_sparrow` of the batch
    follows that model, the rest are Disney's.
    """
    simple = int(size * torrance_sparrow)
    disney_count = size // 2 - simple
    parameters = random_disney(disney_count, g)
    states = random_torrance_sparrow(simple, g)
    sources: list[Evaluate] = [
        _BentMeasured.draw(measured, size - size // 2, 1 - bent, g),
        lambda angles: disney.evaluate(parameters, angles),
    ]
    if simple:
        sources.append(lambda angles: ts.evaluate(*states, angles))
    return sources


def loss_angles(n: int, g: torch.Generator) -> Tensor:
    """At most `n` directions [m, 3] above the horizon: theta_h = u^3 pi/2, the others uniform."""
    u = torch.rand(2 * n, 3, generator=g)
    angles = torch.stack(
        (u[:, 0] ** 3 * math.pi / 2, u[:, 1] * math.pi / 2, u[:, 2] * 2 * math.pi), 1
    )
    return angles[above_horizon(angles, margin=0.01)][:n]


def sphere_angles(pixels: int, lights: int, g: torch.Generator) -> tuple[Tensor, Tensor]:
    """Directions and weights with which a few random pixels of a lit sphere are sums.

    Returns angles [pixels * lights, 3] and weights [pixels, lights]: half the lights are drawn by
    cosine, half around the mirror direction, weighted by cosine over density, times a random
    radiance. Any such sum is a linear functional of f, equal for truth and estimate, so its
    tone-mapped difference is a fair (and noise-free) stand-in for the metric.
    """

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=g)

    sin_v = uniform(pixels, 1).sqrt()
    wo = torch.stack((sin_v, torch.zeros_like(sin_v), (1 - sin_v**2).clamp_min(1e-4).sqrt()), -1)
    half_lights = lights // 2
    radius, turn = uniform(pixels, lights), uniform(pixels, lights) * 2 * math.pi
    sin_t = radius.sqrt()
    cosine = torch.stack((sin_t * turn.cos(), sin_t * turn.sin(), (1 - radius).sqrt()), -1)
    alpha = torch.exp(torch.empty(pixels, 1).uniform_(math.log(0.01), math.log(0.6), generator=g))
    tan2 = alpha**2 * radius / (1 - radius).clamp_min(1e-6)
    cos_m = (1 + tan2).rsqrt()
    sin_m = (1 - cos_m**2).clamp_min(0).sqrt()
    half = torch.stack((sin_m * turn.cos(), sin_m * turn.sin(), cos_m), -1)
    mirrored = 2 * (half * wo).sum(-1, keepdim=True) * half - wo
    first = torch.arange(lights) < half_lights
    wi = torch.where(first[None, :, None], cosine, mirrored)
    wo = wo.expand_as(wi)
    angles = from_directions(wi, wo)
    cos_i = wi[..., 2].clamp_min(0)
    cos2_h = angles[..., 0].cos().square()
    density_h = alpha**2 / (math.pi * (cos2_h * (alpha**2 - 1) + 1) ** 2) * cos2_h.sqrt()
    density_mirror = density_h / (4 * angles[..., 1].cos().clamp_min(1e-3))
    density = 0.5 * cos_i / math.pi + 0.5 * density_mirror
    radiance = torch.randn(pixels, lights, generator=g).mul(0.8).sub(0.32).exp()
    weights = cos_i * radiance / density.clamp_min(1e-6) / lights
    return angles.reshape(-1, 3), weights
