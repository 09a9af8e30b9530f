"""What materials a temporal model was trained on, and how far others are from them."""

from __future__ import annotations

from dataclasses import dataclass

from ..backend import Tensor, torch
from ..states import perceptual

__all__ = ("FOREIGN_SHARE", "MOST_CENTERS", "Domain")

FOREIGN_SHARE = 0.5
"""A material with a larger share of its texels outside a model's domain is foreign to it."""

MOST_CENTERS = 2048

_NEIGHBORS = 12
_LARGEST = 0.95  # quantile of the radii: a lone outlier's ball would hold half of what is foreign
_OWN_PATCH = 10
_INSIDE = 0.97
_SMALLEST = 0.05  # radius; nobody sees such a step
_HELD_OUT = 0.2
_MOST_HELD_OUT = 1024
_CHUNK = 1024


@dataclass(frozen=True)
class Domain:
    """Initial states seen in training: `centers` [K, C] (perceptual), at most 2,048, each with the
    radius of the ball around it that counts as known, `radii` [K] > 0.

    Balls are wide where training saw few materials and narrow where it saw many, so that gaps
    between kinds of material (paints and metals, say) stay gaps.
    """

    centers: Tensor
    radii: Tensor

    @classmethod
    def of(cls, initial: Tensor, *, seed: int = 0) -> Domain:
        """From initial states [N, C], N > 0: centers drawn by `seed`, their radii the distance
        of the twelfth nearest center, those of outliers cut, all times one factor.

        That factor, at least 1, is set by texels that are no centers. Each is taken for a material
        never seen: its ten nearest centers, mostly of its own patch in the source, are left out. Of
        such texels 97 % are to be inside. (Texels held out without that are too easy: of other
        tiles of our processes 5 to 30 % fell outside then, and 0 to 4 % do now.)
        """
        g = torch.Generator().manual_seed(seed)
        points = perceptual(initial)[torch.randperm(len(initial), generator=g)]
        count = min(MOST_CENTERS, len(points) - int(len(points) * _HELD_OUT))
        centers, held = points[:count], points[count:][:_MOST_HELD_OUT]
        spacing = torch.cdist(centers, centers).kthvalue(min(_NEIGHBORS, count), 1).values
        spacing = spacing.clamp_max(spacing.quantile(_LARGEST)).clamp_min(_SMALLEST)
        domain = cls(centers, spacing)
        if len(held) == 0 or count <= _OWN_PATCH:
            return domain
        away = torch.cdist(held, centers)
        own = away.topk(_OWN_PATCH, 1, largest=False).indices
        nearest = (away / domain.radii).scatter(1, own, torch.inf).amin(1)
        return cls(centers, domain.radii * nearest.quantile(_INSIDE).clamp_min(1))

    def distance(self, states: Tensor) -> Tensor:
        """How far states [N, C] are from what was seen: [N], 0 at a center, 1 at the border of
        the domain.
        """
        return torch.cat(
            [
                (torch.cdist(some, self.centers) / self.radii).amin(1)
                for some in perceptual(states).split(_CHUNK)
            ]
        )

    def outside(self, states: Tensor) -> Tensor:
        """Whether no ball holds them: boolean [N] of states [N, C]."""
        return self.distance(states) > 1
