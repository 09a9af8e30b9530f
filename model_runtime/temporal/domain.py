"""What materials a temporal model was trained on, and how far others are from them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

__all__ = ("Domain", "perceptual")


def perceptual(parameters: Tensor) -> Tensor:
    """[N, 7] (kd, ks, alpha) -> [N, 7] in which equal steps look about equally large.

    Square roots: of albedos as displays encode them, of alpha as Blender's roughness is.
    """
    return parameters.clamp(0, 4).sqrt()


@dataclass(frozen=True)
class Domain:
    """Initial states seen in training: `centres` [C, 7] (perceptual) and the `radius` they
    cover.
    """

    centres: Tensor
    radius: float

    @classmethod
    def of(cls, initial: Tensor, *, count: int = 256, seed: int = 0) -> Domain:
        """From initial parameters [N, 7]: farthest-point centres and the 99.5 % distance to
        them.
        """
        points = perceptual(initial)
        g = torch.Generator().manual_seed(seed)
        order = torch.randperm(len(points), generator=g)
        points, held = points[order[len(order) // 5 :]], points[order[: len(order) // 5]]
        chosen = [0]
        distance = (points - points[0]).square().sum(1)
        for _ in range(min(count, len(points)) - 1):
            chosen.append(int(distance.argmax()))
            distance = torch.minimum(distance, (points - points[chosen[-1]]).square().sum(1))
        centres = points[chosen]
        radius = torch.cdist(held, centres).amin(1).quantile(0.995) if len(held) else 0.0
        return cls(centres, float(radius))

    def outside(self, parameters: Tensor) -> Tensor:
        """Boolean [N]: farther from every centre than twice the radius that training covered."""
        nearest = torch.cdist(perceptual(parameters), self.centres).amin(1)
        return nearest > max(2 * self.radius, 0.05)
