"""Random analytic BRDFs: the Disney model with its 11 parameters, and Torrance-Sparrow."""

from __future__ import annotations

import torch
from torch import Tensor

from model_runtime.brdf.disney import DisneyParameters

__all__ = ("random_disney", "random_torrance_sparrow")


def random_disney(n: int, generator: torch.Generator) -> DisneyParameters:
    """`n` materials with every parameter uniform in 0..1 (the paper's synthesized BRDFs)."""

    def draw(*shape: int) -> Tensor:
        return torch.rand(n, *shape, generator=generator)

    return DisneyParameters(draw(3), *(draw() for _ in range(10)))


def random_torrance_sparrow(n: int, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """`n` materials (kd [n, 3], ks [n, 3], alpha [n]) that cover what textures hold.

    A third are metals (no diffuse, colored specular), a third dielectrics (weak white specular),
    a third anything; alpha = roughness^2 with roughness uniform in 0.02..1.
    """

    def draw(*shape: int) -> Tensor:
        return torch.rand(n, *shape, generator=generator)

    kind = torch.randint(0, 3, (n, 1), generator=generator)
    kd = draw(3) * draw(1)
    ks = draw(3).mul(0.6).add(0.4) * draw(1)
    gray = draw(1) * 0.12
    kd = torch.where(kind == 0, kd * 0.03, kd)
    ks = torch.where(kind == 1, gray.expand_as(ks), ks)
    mono = draw(1) < 0.5
    ks = torch.where(mono, ks.mean(1, keepdim=True).expand_as(ks), ks)
    alpha = (0.02 + 0.98 * draw()).square()
    return kd, ks, alpha
