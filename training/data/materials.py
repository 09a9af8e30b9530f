"""Endless random materials to train an encoder on: measured ones, bent and mixed, and analytic
ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields

import torch
from torch import Tensor

from model_runtime.brdf import disney
from model_runtime.brdf import torrance_sparrow as ts
from model_runtime.brdf.disney import DisneyParameters
from model_runtime.brdf.half_angle import above_horizon, cosines, from_directions
from model_runtime.representation.lobes import TRUSTED_COSINE

from ..distributed import Share
from .analytic import random_disney, random_torrance_sparrow
from .nbrdf import NeuralBRDFs

__all__ = ("damage", "draw_batch", "loss_angles", "sphere_angles")

Evaluate = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class _Coat:
    """A polished dielectric layer on some of n materials: a sharp peak, and haze around it.

    Both are Student-t distributions of slopes, GGX for gamma = 1 and Beckmann for gamma to infinity
    (Ribardiere et al. 2017, "STD: Student's t-Distribution of Slopes for Microfacet Based BSDFs"),
    with Schlick's Fresnel term, which also takes from what lies below.
    """

    coated: Tensor
    alpha: Tensor
    gamma: Tensor
    weight: Tensor
    f0: Tensor

    @classmethod
    def draw(cls, coated: Tensor, g: torch.Generator) -> _Coat:
        """Random layers on the materials where `coated` [n] holds."""
        rows = coated.nonzero()[:, 0]

        def log_uniform(low: float, high: float) -> Tensor:
            u = torch.rand(len(rows), 1, generator=g)
            return torch.exp(math.log(low) + u * math.log(high / low))

        peak = log_uniform(0.001, 0.2)
        haze = (peak * log_uniform(2, 20)).clamp_max(0.6)
        strength = torch.cat((log_uniform(0.3, 1.5), log_uniform(0.003, 0.5)), 1)
        gamma = torch.cat((log_uniform(0.7, 20), log_uniform(0.7, 20)), 1)
        return cls(rows, torch.cat((peak, haze), 1), gamma, strength, log_uniform(0.02, 0.2))

    def of(self, mine: Share) -> _Coat:
        """The layers on the materials that are `mine`."""
        place = self.coated - mine.first
        here = (place >= 0) & (place % mine.step == 0)
        rows = torch.div(place[here], mine.step, rounding_mode="floor")
        drawn = (self.alpha[here], self.gamma[here], self.weight[here], self.f0[here])
        return _Coat(*(each.to(mine.device) for each in (rows, *drawn)))

    def __call__(self, f: Tensor, angles: Tensor) -> Tensor:
        """`f` [n, M, 3] at `angles` [M, 3], with the layer."""
        cos_i, cos_o, cos_h, cos_d = cosines(angles)
        a2, gamma = self.alpha.square()[..., None], self.gamma[..., None]
        cos2 = cos_h.square()
        slope = (1 - cos2) / (cos2 * a2).clamp_min(1e-12)
        density = torch.exp(-(gamma + 1) * torch.log1p(slope / gamma)) / (math.pi * a2 * cos2**2)
        fresnel = self.f0 + (1 - self.f0) * (1 - cos_d).clamp(0, 1) ** 5
        lobes = self.weight[..., None] * density
        for cos in (cos_i.clamp_min(0), cos_o.clamp_min(0)):
            lobes = lobes / (cos + (cos**2 + a2 * (1 - cos**2)).sqrt()).clamp_min(0.02)
        layer = fresnel * lobes.sum(1)
        through = 1 - fresnel
        coated = f.clone()
        coated[self.coated] = f[self.coated] * through[..., None] + layer[..., None]
        return coated


@dataclass(frozen=True)
class _BentMeasured:
    """n measured materials, each a mixture of two, made sharper or blunter, recolored, whitened,
    faded, polished.

    85 measured materials are few: an encoder trained on them alone stops gaining on unseen ones
    after a third of a run. Mixtures, a stretch of theta_h (a change of roughness), a channel
    matrix, an added diffuse part and a coat are materials that might have been measured as well;
    so are the same ones brighter, as the brightest of MERL reflects a third of the light.
    """

    source: NeuralBRDFs
    first: Tensor
    second: Tensor
    share: Tensor
    stretch: Tensor
    recolor: Tensor
    diffuse: Tensor
    darkening: Tensor
    coat: _Coat

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
        probes = torch.tensor([[0.5, 0.2, 0.0], [0.7, 0.2, 1.6], [0.4, 0.6, 1.6]])
        level = source.evaluate(first, probes).mean(1).amax(1)[:, None]
        whiter = (uniform(1) / (math.pi * level.clamp_min(1e-4))).clamp(0.2, 8)
        recolor = recolor * torch.where(some(0.4), whiter, torch.ones(n, 1))[..., None]
        diffuse = torch.where(some(0.25), uniform(3) * uniform(1) / math.pi, torch.zeros(n, 3))
        darkening = torch.where(some(0.25), uniform(1) * 1.5, torch.zeros(n, 1))
        coat = _Coat.draw(some(0.3)[:, 0], g)
        return cls(source, first, second, share, stretch, recolor, diffuse, darkening, coat)

    def of(self, mine: Share) -> _BentMeasured:
        """Those of the materials that are `mine`."""
        return _BentMeasured(
            source=self.source.to(mine.device),
            first=mine(self.first),
            second=mine(self.second),
            share=mine(self.share),
            stretch=mine(self.stretch),
            recolor=mine(self.recolor),
            diffuse=mine(self.diffuse),
            darkening=mine(self.darkening),
            coat=self.coat.of(mine),
        )

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
        cos_i, cos_o, _, _ = cosines(angles)
        shade = (cos_i * cos_o).clamp_min(1e-6).pow(self.darkening)
        f = torch.einsum("ncd,nmd->nmc", self.recolor, f)
        return self.coat(f + self.diffuse[:, None] * shade[..., None], angles)


def draw_batch(
    measured: NeuralBRDFs, mine: Share, g: torch.Generator, *, bent: float, torrance_sparrow: float
) -> list[Evaluate]:
    """Functions of angles [M, 3] -> f [n, M, 3] that make up the materials of a batch that are
    `mine`.

    Half of all are measured (a share `bent` of them changed), a share `torrance_sparrow` of the
    batch follows that model, the rest are Disney's. `measured` is on the CPU.
    """
    first = mine.whole - mine.whole // 2
    last = int(mine.whole * torrance_sparrow)
    between = mine.whole - first - last
    parameters = random_disney(between, g)
    states = random_torrance_sparrow(last, g)
    changed = _BentMeasured.draw(measured, first, 1 - bent, g)
    of_disney, of_simple = mine.among(first, between), mine.among(first + between, last)
    p = DisneyParameters(*(of_disney(getattr(parameters, f.name)) for f in fields(parameters)))
    kd, ks, alpha = (of_simple(each) for each in states)
    sources: list[tuple[Share, Evaluate]] = [
        (mine.among(0, first), changed.of(mine.among(0, first))),
        (of_disney, lambda angles: disney.evaluate(p, angles)),
        (of_simple, lambda angles: ts.evaluate(kd, ks, alpha, angles)),
    ]
    return [evaluate for rows, evaluate in sources if len(rows)]


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


def damage(
    angles: Tensor, f: Tensor, share: float, g: torch.Generator, mine: Share, *, measured: int = 0
) -> Tensor:
    """`f` [n, M, 3] at `angles` [M, 3], the rows of a batch that are `mine`, as a poor measurement
    gives them, for a `share` of the batch.

    Of the batch's first `measured` rows, three quarters lose what is not to be trusted in a
    measurement.

    A damaged row is one of: cut to its first m samples (16 or more), cut to a random part, without
    grazing directions, without one channel, or noisy (5 % a sample) with a few fireflies. Missing
    samples are NaN.
    """
    n, m = mine.whole, f.shape[1]

    def uniform(*shape: int) -> Tensor:
        return mine(torch.rand(n, *shape, generator=g))

    kind = torch.where(uniform() < share, mine(torch.randint(0, 5, (n,), generator=g)), 5)
    first = torch.arange(m, device=f.device) >= (16 * (m / 16) ** uniform(1))
    cos_i, cos_o, _, _ = cosines(angles)
    low = torch.minimum(cos_i, cos_o)
    grazing = low < uniform(1) * 0.6
    channel = mine(torch.arange(3) == torch.randint(0, 3, (n, 1), generator=g))
    lost = mine(torch.arange(n) < measured) & (uniform() < 0.75)
    lost = lost[:, None] & (low < TRUSTED_COSINE)
    lost |= (kind == 0)[:, None] & first
    lost |= (kind == 1)[:, None] & (uniform(m) < 0.9 * uniform(1))
    lost |= (kind == 2)[:, None] & grazing
    lost = lost[..., None] | ((kind == 3)[:, None] & channel)[:, None]
    noisy = (f * (1 + 0.05 * mine(torch.randn(n, m, 3, generator=g)))).clamp_min(0)
    noisy = torch.where(uniform(m, 1) < 0.01, noisy * 100 ** uniform(m, 1), noisy)
    f = torch.where((kind == 4)[:, None, None], noisy, f)
    return f.masked_fill(lost, math.nan)
