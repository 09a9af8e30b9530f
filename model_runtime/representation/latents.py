"""What every BRDF representation gives and takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ..backend import Tensor, torch

__all__ = (
    "PAPER_SAMPLES",
    "Latents",
    "Representation",
    "inverse_log_transform",
    "log_transform",
)

PAPER_SAMPLES = 16_200
"""Directions at which the paper samples a BRDF to encode it."""


@dataclass(frozen=True)
class Latents:
    """N encoded BRDFs.

    color: [N, 3, k], k numbers for each color channel; permuting the channels of a BRDF permutes
    these rows. shared: [N, d], invariant to that permutation (the paper's z_RGB and z_BRDF).
    """

    color: Tensor
    shared: Tensor

    def flat(self) -> Tensor:
        """[N, 3 k + d], color first."""
        return torch.cat((self.color.flatten(1), self.shared), 1)

    def to(self, device: torch.device) -> Latents:
        """The same on another device."""
        return Latents(self.color.to(device), self.shared.to(device))

    def unflat(self, flat: Tensor) -> Latents:
        """The inverse of `flat` for vectors [..., 3 k + d] laid out as these latents are."""
        split = self.color.shape[1] * self.color.shape[2]
        flat = flat.reshape(-1, flat.shape[-1])
        return Latents(flat[:, :split].reshape(len(flat), *self.color.shape[1:]), flat[:, split:])


class Representation(Protocol):
    """A BRDF autoencoder; `name` and the state of its tensors make its identity."""

    name: str

    @property
    def latent_sizes(self) -> tuple[int, int]:
        """How many latents the three channels have together, and how many are shared."""
        ...

    def sample_angles(self, m: int, *, measured: bool = False) -> Tensor:
        """About `m` directions [m', 3] at which `encode` wants a BRDF, which may be `measured`."""
        ...

    def encode(self, angles: Tensor, f: Tensor) -> Latents:
        """Latents of N BRDFs with values `f` [N, M, 3] per steradian at `angles` [M, 3]."""
        ...

    def encode_parameters(self, states: Tensor) -> Latents:
        """Latents of Torrance-Sparrow materials `states` [N, C]."""
        ...

    def decode(self, latents: Latents, angles: Tensor) -> Tensor:
        """f [N, M, 3] of N latents at `angles` [M, 3]; finite and not negative."""
        ...


def log_transform(a: Tensor) -> Tensor:
    """l(a) = log(1 + log(1 + log(1 + log(1 + a)))), equation 1 of the paper, for a >= 0."""
    for _ in range(4):
        a = torch.log1p(a)
    return a


def inverse_log_transform(b: Tensor) -> Tensor:
    """l^-1(b), each step's result clamped to 10 as in the published code, since it overflows
    fast.
    """
    for _ in range(3):
        b = torch.expm1(b).clamp(max=10)
    return torch.expm1(b)
