"""How much light a BRDF gives back: albedos by a quadrature that knows where mirror peaks are."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from model_runtime.brdf.half_angle import from_directions

__all__ = ("INCIDENCES", "Albedos")

INCIDENCES = (0.0, 30.0, 60.0, 75.0, 85.0)
"""Degrees from the normal at which directional albedos are reported."""

_NARROWEST = 3e-4
"""theta_h, in radians, below which the nodes are equally spaced: a peak of alpha 1e-3 is wider."""


def _gauss(n: int) -> tuple[Tensor, Tensor]:
    """Nodes and weights [n] of Gauss and Legendre's rule on 0..1, float64."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    return torch.from_numpy(nodes / 2 + 0.5), torch.from_numpy(weights / 2)


def _outgoing(theta_i: Tensor, rings: int, turns: int) -> tuple[Tensor, Tensor]:
    """Angles [T, M, 3] and weights cos_o d omega_o [T, M] for light at `theta_i` [T] radians.

    The nodes stand for half vectors (theta_h, phi_h): omega_o = 4 (wi.h) omega_h. Rings follow
    log(theta_h), so that peaks of any width get as many, and end where wo meets the horizon,
    2 theta_h = pi / 2 + atan2(sin theta_i cos phi_h, cos theta_i). The integrand is smooth in
    there, and the rule converges fast.
    """
    phi = (torch.arange(turns, dtype=torch.float64) + 0.5) * 2 * math.pi / turns
    sin_i, cos_i = theta_i.sin()[:, None, None], theta_i.cos()[:, None, None]
    last = (torch.atan2(sin_i * phi.cos(), cos_i) + math.pi / 2) / 2
    node, weight = _gauss(rings)
    span = torch.log1p(last / _NARROWEST)
    theta_h = _NARROWEST * torch.expm1(node[:, None] * span)
    step = weight[:, None] * span * (theta_h + _NARROWEST) * (2 * math.pi / turns)
    sin_h = theta_h.sin()
    half = torch.stack(
        torch.broadcast_tensors(sin_h * phi.cos(), sin_h * phi.sin(), theta_h.cos()), -1
    )
    wi = torch.stack(torch.broadcast_tensors(sin_i, 0 * sin_i, cos_i), -1).expand_as(half)
    cos_d = (wi * half).sum(-1)
    wo = 2 * cos_d[..., None] * half - wi
    weights = wo[..., 2].clamp_min(0) * 4 * cos_d * sin_h * step
    return from_directions(wi, wo).flatten(1, 2), weights.flatten(1)


@dataclass(frozen=True)
class Albedos:
    """Albedos of materials: shares of the incident light, 0 to 1 for what conserves energy.

    directional: [N, I, 3], of light from each of `INCIDENCES`
    diffuse: [N, 3], of light that comes equally from everywhere (bihemispherical)
    """

    directional: Tensor
    diffuse: Tensor

    @classmethod
    def of(
        cls, evaluate: Callable[[Tensor], Tensor], *, rings: int = 40, turns: int = 48
    ) -> Albedos:
        """Integrate `evaluate`(angles [M, 3]) -> f [N, M, 3] over `rings` x `turns` directions.

        An incidence at a time. With the defaults, mirrors of alpha 1e-3 to 1 are right to 1e-4,
        Disney's and measured materials to 5e-3 up to 85 degrees (tests/test_encoder_properties.py).
        """
        node, weight = _gauss(8)
        theta_i = torch.cat(
            (torch.tensor(INCIDENCES, dtype=torch.float64).deg2rad(), node.sqrt().asin())
        )
        angles, weights = _outgoing(theta_i, rings, turns)
        each = torch.stack(
            [
                torch.einsum("nmc,m->nc", evaluate(a), w)
                for a, w in zip(angles.float(), weights.float(), strict=True)
            ],
            1,
        )
        fixed = len(INCIDENCES)
        return cls(each[:, :fixed], torch.einsum("ntc,t->nc", each[:, fixed:], weight.float()))
