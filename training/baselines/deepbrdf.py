"""DeepBRDF: an autoencoder over the images that a measured table is a stack of.

B. Hu, J. Guo, Y. Chen, M. Li, Y. Guo: DeepBRDF: A Deep Representation for Manipulating Measured
BRDF. Computer Graphics Forum 39(2), 2020. Written from its idea: slices of the table (theta_h by
theta_d, one a phi_d and color, logarithms) are the channels of an image, residual convolutions take
that to ten numbers and back. Smaller than the published one, so that it trains in an hour of a
core: coarser slices, and a quarter turn of phi_d, which reciprocity and mirror symmetry make the
whole. What lies between entries is interpolated.
"""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor, nn

from model_runtime.brdf import torrance_sparrow
from model_runtime.channels import optics
from model_runtime.representation.latents import Latents
from model_runtime.representation.lobes import compress, expand

__all__ = ("DeepBRDF", "around")

_GRID = (32, 16, 6)
"""Entries along theta_h, theta_d and phi_d."""

_WIDTHS = (32, 48, 64, 96)
"""Channels of the images; each is half as large a side as the one before."""

_LATENTS = 10
_SCALE = 5.0
"""Compressed reflectances are about so large."""

_LARGEST = 16.2
_HORIZON = 0.02
"""Entries below the horizon hold what lies so many radians above it."""


class _Residual(nn.Module):
    """Two convolutions added to what they are given, which they leave as it is at first."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(width, width, 3, padding=1)
        self.second = nn.Conv2d(width, width, 3, padding=1)
        nn.init.zeros_(self.second.weight)

    def forward(self, image: Tensor) -> Tensor:
        """`image` [N, width, H, D]."""
        silu = nn.functional.silu
        return image + self.second(silu(self.first(silu(image))))


class DeepBRDF(nn.Module):
    """See the module's description. All latents are shared: it knows no colors apart."""

    name = "deepbrdf"

    encoder_angles: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("encoder_angles", _table_angles(), persistent=False)
        rows, columns, slices = _GRID
        images, shrunk = 3 * slices, 2 ** (len(_WIDTHS) - 1)
        self.smallest = (_WIDTHS[-1], rows // shrunk, columns // shrunk)
        down: list[nn.Module] = [nn.Conv2d(images, _WIDTHS[0], 3, padding=1), _Residual(_WIDTHS[0])]
        up: list[nn.Module] = [nn.Conv2d(_WIDTHS[0], images, 3, padding=1), _Residual(_WIDTHS[0])]
        for wide, narrow in itertools.pairwise(_WIDTHS):
            down += [nn.Conv2d(wide, narrow, 3, stride=2, padding=1), _Residual(narrow)]
            up += [nn.ConvTranspose2d(narrow, wide, 2, stride=2), _Residual(narrow)]
        self.down, self.up = nn.Sequential(*down), nn.Sequential(*up[::-1])
        self.to_latent = nn.Linear(math.prod(self.smallest), _LATENTS)
        self.from_latent = nn.Linear(_LATENTS, math.prod(self.smallest))

    @property
    def latent_sizes(self) -> tuple[int, int]:
        """Numbers for the three channels together, and shared ones."""
        return 0, _LATENTS

    def sample_angles(self, m: int, *, measured: bool = False) -> Tensor:
        """Those of the table's entries [3072, 3], however few are offered: it reads all."""
        return self.encoder_angles

    def encode(self, angles: Tensor, f: Tensor) -> Latents:
        """Latents of `f` [N, M, 3] at the `angles` [M, 3] of `sample_angles`."""
        assert len(angles) == math.prod(_GRID)
        rows, columns, slices = _GRID
        table = compress(f.clamp(0, 1e5)).unflatten(1, (rows, columns, slices)) / _SCALE
        image = table.permute(0, 3, 4, 1, 2).flatten(1, 2)
        latent = self.to_latent(nn.functional.silu(self.down(image)).flatten(1))
        return Latents(f.new_zeros(len(f), 3, 0), latent)

    def encode_parameters(self, states: Tensor) -> Latents:
        """Latents of Torrance-Sparrow materials `states` [N, C], sampled."""
        angles = self.encoder_angles
        return self.encode(angles, torrance_sparrow.evaluate(*optics(states), angles))

    def decode(self, latents: Latents, angles: Tensor) -> Tensor:
        """f [N, M, 3] at `angles` [M, 3], interpolated between logarithms; below 0 only in
        training, which would not find back from a flat 0.
        """
        small = self.from_latent(latents.shared).unflatten(1, self.smallest)
        table = self.up(small).unflatten(1, (_GRID[2], 3)).permute(3, 4, 1, 0, 2)
        places, shares = around(angles)
        between = nn.functional.embedding_bag(
            places, table.reshape(math.prod(_GRID), -1), mode="sum", per_sample_weights=shares
        )
        values = (between * _SCALE).clamp(-5 if self.training else 0, _LARGEST)
        return expand(values.unflatten(1, (-1, 3)).transpose(0, 1))


def _table_angles() -> Tensor:
    """Directions [M, 3] of the table's entries: MERL's spacing of theta_h, dense at the peak."""
    theta_h, theta_d, phi_d = (torch.linspace(0, 1, n, dtype=torch.float64) for n in _GRID)
    quarter = math.pi / 2
    grid = torch.cartesian_prod(theta_h.square(), theta_d, phi_d) * quarter
    horizon = torch.atan2(grid[:, 0].cos(), grid[:, 2].cos() * grid[:, 0].sin())
    grid[:, 0] = grid[:, 0].clamp_max(quarter - _HORIZON)
    grid[:, 1] = torch.minimum(grid[:, 1], horizon - _HORIZON).clamp_min(0)
    return grid.float()


def around(angles: Tensor) -> tuple[Tensor, Tensor]:
    """The eight entries [M, 8] around each of `angles` [M, 3], and their shares."""
    theta_h, theta_d, phi_d = (angles * (2 / math.pi)).unbind(-1)
    folded = (torch.remainder(phi_d + 1, 2) - 1).abs()
    places = torch.stack((theta_h.clamp_min(0).sqrt(), theta_d, folded), 1).clamp(0, 1)
    last = places.new_tensor(_GRID) - 1
    places = places * last
    low = torch.minimum(places.floor(), last - 1)
    corners = torch.cartesian_prod(*3 * (torch.arange(2),))
    each = (low.long()[:, None] + corners).unbind(-1)
    entries = (each[0] * _GRID[1] + each[1]) * _GRID[2] + each[2]
    share = (places - low)[:, None]
    return entries, torch.where(corners.bool(), share, 1 - share).prod(-1)
