"""A reference for films over a ground: random walks through the stack, free of position.

A film is a rough dielectric boundary (GGX) over a medium that absorbs; under it lies a ground with
a Torrance-Sparrow BRDF. Walks from both directions, refracted into the film, meet at the ground
after every bounce (after Guo, Hasan and Zhao, Position-Free Monte Carlo Simulation for Arbitrary
Layered BSDFs, 2018): what is not refracted out is reflected inside and goes on, for as long as a
roulette on what is left of it lets it. Facets that hide one another lose light, the more the
rougher the boundary is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from model_runtime.brdf.half_angle import directions, from_directions
from model_runtime.brdf.torrance_sparrow import specular_lobe
from model_runtime.states import joined

from .films import fresnel

__all__ = ("Film", "Ground", "boundary", "evaluate_stack")

_BOUNCES = 40  # that hardly any walk lives to see
_GLOSSY = 0.5  # of the walks leave the ground by its highlight, where it has one
_TINY = 1e-6


@dataclass(frozen=True)
class Film:
    """n films: `alpha` [n] of the boundary (GGX), index of refraction `ior`, and optical depth
    [n, 3] straight through.
    """

    alpha: Tensor
    depth: Tensor
    ior: float = 1.5

    def __getitem__(self, rows: Tensor | slice) -> Film:
        return Film(self.alpha[rows], self.depth[rows], self.ior)


@dataclass(frozen=True)
class Ground:
    """n grounds: kd, ks [n, 3] and alpha [n] of a Torrance-Sparrow BRDF."""

    kd: Tensor
    ks: Tensor
    alpha: Tensor

    def __getitem__(self, rows: Tensor | slice) -> Ground:
        return Ground(self.kd[rows], self.ks[rows], self.alpha[rows])

    def states(self) -> Tensor:
        """As states [n, C]."""
        return joined(self.kd, self.ks, self.alpha)


def _fresnel(cosine: Tensor, ior: float) -> Tensor:
    return torch.from_numpy(fresnel(cosine.numpy(), ior))


def evaluate_stack(
    film: Film, ground: Ground, angles: Tensor, *, walks: int, generator: torch.Generator
) -> Tensor:
    """f [n, M, 3] of n stacks at half-angle coordinates `angles` [M, 3], both directions above the
    horizon: the mean of so many walks each.
    """
    n, m = len(film.alpha), len(angles)
    wi, wo = directions(angles)
    draw, total = _Draw(generator), torch.zeros(n * m, 3)
    place = torch.arange(n * m).repeat_interleave(walks)
    stack, angle = place // m, place % m
    below, weight = _into(wi[angle], film.alpha[stack], film.ior, draw)
    through = weight[:, None] * _crossed(film.depth[stack], below)
    for _ in range(_BOUNCES):
        alpha, depth = film.alpha[stack], film.depth[stack]
        kd, ks, gloss = ground.kd[stack], ground.ks[stack], ground.alpha[stack]
        out, leaving = _into(wo[place % m], alpha, film.ior, draw)
        seen = _ground(kd, ks, gloss, below, out) * leaving[:, None] / film.ior**2
        total.index_add_(0, place, through * seen * _crossed(depth, out))
        up, scattered = _scatter(kd, ks, gloss, below, draw)
        below, kept = _back(up, alpha, film.ior, draw)
        crossed = _crossed(depth, up) * _crossed(depth, below)
        through = through * scattered * kept[:, None] * crossed
        likely = through.amax(1).clamp_max(1)
        lives = draw.uniform(len(likely))[0] < likely
        place, stack, below = place[lives], stack[lives], below[lives]
        through = through[lives] / likely[lives, None]
    return boundary(film, angles) + total.reshape(n, m, 3) / walks


def _crossed(depth: Tensor, direction: Tensor) -> Tensor:
    """What a film of `depth` [k, 3] leaves of light along `direction` [k, 3] inside it."""
    return torch.exp(-depth / direction[:, 2:].clamp_min(_TINY))


def boundary(film: Film, angles: Tensor) -> Tensor:
    """f [n, M, 1] of what the boundary itself reflects, of n films."""
    wi, wo = directions(angles)
    half = ((wi + wo).norm(dim=-1) / 2).clamp(0, 1)  # the cosine between either and their half
    return (specular_lobe(film.alpha, angles) * _fresnel(half, film.ior))[..., None]


@dataclass(frozen=True)
class _Draw:
    generator: torch.Generator

    def uniform(self, count: int) -> tuple[Tensor, Tensor]:
        first, second = torch.rand(2, count, generator=self.generator)
        return first, second


def _facet(direction: Tensor, alpha: Tensor, draw: _Draw) -> Tensor:
    """Normals [k, 3] of facets of a GGX surface as `direction` sees them (Heitz 2018)."""
    u, v = draw.uniform(len(direction))
    scale = torch.stack((alpha, alpha, torch.ones_like(alpha)), -1)
    seen = torch.nn.functional.normalize(direction * scale, dim=-1)
    length = seen[:, :2].norm(dim=-1, keepdim=True)
    along = torch.where(
        length > _TINY,
        torch.stack((-seen[:, 1], seen[:, 0], torch.zeros_like(alpha)), -1)
        / length.clamp_min(_TINY),
        torch.tensor((1.0, 0.0, 0.0)),
    )
    across = torch.linalg.cross(seen, along)
    radius, turn = u.sqrt(), 2 * math.pi * v
    x = radius * turn.cos()
    share = (1 + seen[:, 2]) / 2
    y = (1 - share) * (1 - x.square()).clamp_min(0).sqrt() + share * radius * turn.sin()
    z = (1 - x.square() - y.square()).clamp_min(0).sqrt()
    normal = x[:, None] * along + y[:, None] * across + z[:, None] * seen
    flat = torch.cat((normal[:, :2] * alpha[:, None], normal[:, 2:].clamp_min(_TINY)), -1)
    return torch.nn.functional.normalize(flat, dim=-1)


def _masking(cosine: Tensor, alpha: Tensor) -> Tensor:
    """G1 of a direction."""
    cosine = cosine.clamp(_TINY, 1)
    tangent2 = (1 - cosine.square()) / cosine.square()
    return 2 / (1 + (1 + alpha.square() * tangent2).sqrt())


def _into(direction: Tensor, alpha: Tensor, ior: float, draw: _Draw) -> tuple[Tensor, Tensor]:
    """Directions [k, 3] inside the film, pointing up, from which light along `direction` [k, 3]
    above it would come or go, and what of it passes.
    """
    facet = _facet(direction, alpha, draw)
    cosine = (direction * facet).sum(-1).clamp(0, 1)
    inner = (1 - (1 - cosine.square()) / ior**2).clamp_min(0).sqrt()
    # What is refracted goes down; both directions at the ground point away from it.
    up = direction / ior - (cosine / ior - inner)[:, None] * facet
    passed = (1 - _fresnel(cosine, ior)) * _masking(up[:, 2], alpha) * (up[:, 2] > 0)
    return up, passed


def _back(up: Tensor, alpha: Tensor, ior: float, draw: _Draw) -> tuple[Tensor, Tensor]:
    """Where what goes `up` [k, 3] is reflected to inside the film, as a direction that points up
    from the ground again, and what of it is.
    """
    facet = _facet(up, alpha, draw)
    cosine = (up * facet).sum(-1).clamp(0, 1)
    mirrored = 2 * cosine[:, None] * facet - up  # both above the boundary's inner side
    kept = _fresnel(cosine, 1 / ior) * _masking(mirrored[:, 2], alpha) * (mirrored[:, 2] > 0)
    return mirrored, kept


def _ground(kd: Tensor, ks: Tensor, alpha: Tensor, first: Tensor, second: Tensor) -> Tensor:
    """f [k, 3] of the ground for pairs of directions."""
    angles = from_directions(first, second)
    masked = _masking(first[:, 2], alpha) * _masking(second[:, 2], alpha)
    cosines = (first[:, 2] * second[:, 2]).clamp_min(_TINY)
    return kd / math.pi + ks * (_facets(alpha, angles) * masked / (4 * cosines))[:, None]


def _facets(alpha: Tensor, angles: Tensor) -> Tensor:
    """D of GGX, of pairs of directions: [k]."""
    sin2, a2 = angles[:, 0].sin().square(), alpha.square()
    return a2 / (math.pi * (sin2 + a2 * (1 - sin2)).square())


def _scatter(
    kd: Tensor, ks: Tensor, alpha: Tensor, direction: Tensor, draw: _Draw
) -> tuple[Tensor, Tensor]:
    """Directions [k, 3] in which the ground scatters light, and f cosine / density [k, 3]."""
    u, v = draw.uniform(len(kd))
    radius, turn = u.sqrt(), 2 * math.pi * v
    diffuse = torch.stack(
        (radius * turn.cos(), radius * turn.sin(), (1 - u).clamp_min(0).sqrt()), -1
    )
    facet = _facet(direction, alpha, draw)
    cosine = (direction * facet).sum(-1)
    glossy = 2 * cosine[:, None] * facet - direction
    shiny = (ks.mean(-1) > 0) * _GLOSSY
    chosen, _ = draw.uniform(len(kd))
    out = torch.where((chosen < shiny)[:, None], glossy, diffuse)
    angles = from_directions(direction, out)
    seen = (
        _facets(alpha, angles)
        * _masking(direction[:, 2], alpha)
        / (4 * direction[:, 2].clamp_min(_TINY))
    )
    density = (1 - shiny) * out[:, 2].clamp_min(0) / math.pi + shiny * seen
    value = _ground(kd, ks, alpha, direction, out) * out[:, 2:].clamp_min(0)
    return out, value / density.clamp_min(_TINY)[:, None] * (out[:, 2:] > 0)
