"""A BRDF autoencoder built on analytic lobes: faster and more accurate than the paper's.

The encoder sees the BRDF at one fixed set of directions, or at any part of it, so it is a plain MLP
a channel over values and a mask, pooled over channels. The decoder turns the latents into a diffuse
term and generalized GGX lobes with grazing gains, and multiplies the sum by a learned low-rank
correction. All angular inputs are symmetric in the two directions: reciprocity and channel
equivariance hold by construction, and the output is finite and not negative.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

from ..backend import Tensor, nn, torch
from ..brdf.half_angle import above_horizon, cosines, network_input
from ..channels import ALPHA, ALPHA_MIN, KD, KS
from .latents import Latents

__all__ = ("TRUSTED_COSINE", "LobeConfig", "LobeRepresentation", "compress", "expand", "mlp")

FLOOR = 0.01
"""Reflectance (1/sr) below which differences stop mattering: a hundredth is a near-black diffuse.
"""


TRUSTED_COSINE = 0.2
"""Least cosine of light and eye (78.5 degrees) at which a measurement is read: what files say of
directions closer to grazing is extrapolation, and misleads an encoder about all the rest."""

_FIREFLY = 12
"""A sample so many times as bright as seven of its eight neighbors is an error."""


def compress(f: Tensor) -> Tensor:
    """log(1 + f / 0.01): about linear for near-black, logarithmic above."""
    return torch.log1p(f * (1 / FLOOR))


def expand(c: Tensor) -> Tensor:
    """The inverse of `compress`."""
    return torch.expm1(c) * FLOOR


@dataclass(frozen=True)
class LobeConfig:
    """Sizes: latents a channel and shared, lobes, width of the MLPs, rank of the correction."""

    color_latents: int = 4
    shared_latents: int = 12
    lobes: int = 3
    width: int = 256
    rank: int = 96


def mlp(*sizes: int) -> nn.Sequential:
    """Linear layers between vectors of these sizes, with SiLU between them."""
    layers: list[nn.Module] = []
    for i, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
        layers += [nn.SiLU()] * (i > 0) + [nn.Linear(inputs, outputs)]
    return nn.Sequential(*layers)


def encoder_directions() -> Tensor:
    """The fixed directions [258, 3]: dense towards the mirror peak, out to grazing, above the
    horizon.

    Each is the one farthest from all before it, so that the first m cover the BRDF for every m.
    """
    near = (0.0, 0.002, 0.006, 0.012, 0.022, 0.036, 0.056, 0.085, 0.125)
    theta_h = torch.tensor((*near, 0.18, 0.26, 0.36, 0.5, 0.68, 0.9, 1.15, 1.35))
    theta_d = torch.tensor((0.03, 0.4, 0.75, 1.05, 1.3, 1.45))
    phi_d = torch.tensor((0.0, 0.25, 0.5)) * math.pi
    grid = torch.cartesian_prod(theta_h, theta_d, phi_d)
    sizes = (len(theta_h), len(theta_d), len(phi_d))
    place = torch.cartesian_prod(*(torch.linspace(0, 1, size) for size in sizes))
    inside = above_horizon(grid, margin=0.03)
    grid, place = grid[inside], place[inside] * torch.tensor((2.0, 1.0, 0.5))
    order = [0]
    distance = (place - place[0]).norm(dim=1)
    while len(order) < len(grid):
        order.append(int(distance.argmax()))
        distance = torch.minimum(distance, (place - place[order[-1]]).norm(dim=1))
    return grid[order]


class LobeRepresentation(nn.Module):
    """See the module's description; `config` holds the sizes."""

    name = "lobes"

    encoder_angles: Tensor
    neighbors: Tensor

    def __init__(self, config: LobeConfig = LobeConfig()) -> None:
        super().__init__()
        self.config = config
        k, d, lobes, width = (
            config.color_latents,
            config.shared_latents,
            config.lobes,
            config.width,
        )
        angles = encoder_directions()
        place = torch.stack(
            (torch.log(angles[:, 0] + 0.003) * 0.35, angles[:, 1] / 1.5, angles[:, 2] / math.pi), 1
        )
        near = torch.cdist(place, place).fill_diagonal_(math.inf).argsort(1)[:, :8]
        self.register_buffer("encoder_angles", angles, persistent=False)
        self.register_buffer("neighbors", near, persistent=False)
        self.per_channel = mlp(2 * len(self.encoder_angles), width, width)
        self.to_shared = mlp(2 * width, width, d)
        self.to_color = mlp(width + d, width // 2, k)
        self.to_shapes = mlp(d + k, width // 2, 2 * lobes)
        self.to_weights = mlp(2 * k + d, width, width, 2 + 2 * lobes + config.rank)
        self.basis = mlp(8, 128, 128, config.rank)
        self.from_channel = mlp(3, width, width)
        self.from_pooled = mlp(2 * width, width, d)
        self.from_each = mlp(width + d, width, k)
        last_shapes, last_weights = self.to_shapes[-1], self.to_weights[-1]
        assert isinstance(last_shapes, nn.Linear)
        assert isinstance(last_weights, nn.Linear)
        with torch.no_grad():
            for last in (last_shapes, last_weights):
                last.weight.mul_(0.1)
                last.bias.zero_()
            last_shapes.bias[:lobes] = torch.linspace(-3.5, -0.5, lobes)
            last_weights.weight[2 + 2 * lobes :].zero_()

    @property
    def latent_sizes(self) -> tuple[int, int]:
        """Numbers for the three channels together, and shared ones."""
        return 3 * self.config.color_latents, self.config.shared_latents

    def sample_angles(self, m: int, *, measured: bool = False) -> Tensor:
        """The first `m` of the fixed directions, 258 at most: more would add nothing. Of a
        `measured` BRDF, those that can be trusted.
        """
        angles = self.encoder_angles
        if measured:
            cos_i, cos_o, _, _ = cosines(angles)
            angles = angles[torch.minimum(cos_i, cos_o) >= TRUSTED_COSINE]
        return angles[:m]

    def encode(self, angles: Tensor, f: Tensor) -> Latents:
        """Latents of `f` [N, M, 3] at any of the fixed directions, in any order.

        NaN and infinity mark samples that are missing; fireflies are found and left out.
        """
        found = (angles[:, None] == self.encoder_angles).all(2)
        assert bool(found.any(1).all())
        given = f.new_full((len(f), len(self.encoder_angles), 3), math.nan)
        given[:, found.float().argmax(1)] = f
        given = given.transpose(1, 2)
        known = given.isfinite()
        given = torch.where(known, given, 0).clamp(0, 1e5)
        known = known & ~self._fireflies(given, known)[:, None]
        seen = torch.where(known, compress(given) * 0.2, 0)
        features = nn.functional.silu(self.per_channel(torch.cat((seen, known.float()), 2)))
        trusted = known.any(2, keepdim=True)
        mean = (features * trusted).sum(1) / trusted.sum(1).clamp_min(1)
        highest = features.masked_fill(~trusted, -1).amax(1)
        shared = self.to_shared(torch.cat((mean, highest), 1))
        each = torch.cat((features, shared[:, None].expand(-1, 3, -1)), 2)
        return Latents(self.to_color(each), shared)

    def _fireflies(self, f: Tensor, known: Tensor) -> Tensor:
        """Which samples [N, M] of `f` [N, 3, M] are too bright to be true."""
        brightness = f.sum(1) + 0.003
        similar = _FIREFLY * brightness[:, self.neighbors] > brightness[..., None]
        similar |= ~known.any(1)[:, self.neighbors]
        return similar.sum(2) <= 1

    def encode_parameters(self, states: Tensor) -> Latents:
        """Latents of Torrance-Sparrow materials `states` [N, C], unsampled.

        An MLP trained to give what `encode` gives for the same materials.
        """
        kd, ks = (compress(states[:, part].clamp(0, 1e4)) for part in (KD, KS))
        alpha = states[:, ALPHA].clamp_min(ALPHA_MIN).log().expand(-1, 3)
        seen = torch.stack((kd * 0.4 - 1, ks * 0.4 - 1, alpha * 0.4 + 1), 2)
        features = nn.functional.silu(self.from_channel(seen))
        shared = self.from_pooled(torch.cat((features.mean(1), features.amax(1)), 1))
        each = torch.cat((features, shared[:, None].expand(-1, 3, -1)), 2)
        return Latents(self.from_each(each), shared)

    def decode(self, latents: Latents, angles: Tensor) -> Tensor:
        """f [N, M, 3] at `angles` [M, 3]."""
        lobes = self.config.lobes
        mean_color = latents.color.mean(1)
        shapes = self.to_shapes(torch.cat((latents.shared, mean_color), 1))
        alpha = shapes[:, :lobes].clamp(-8.5, 0.5).exp()
        tail = 1 + 7 * torch.sigmoid(shapes[:, lobes:] - 1.7)
        n = len(alpha)
        per_channel = torch.cat(
            (
                latents.color,
                mean_color[:, None].expand(-1, 3, -1),
                latents.shared[:, None].expand(-1, 3, -1),
            ),
            2,
        )
        weights = self.to_weights(per_channel)
        gains = weights[..., : 2 + 2 * lobes].clamp(-14, 6).exp()
        cos_i, cos_o, _, cos_d = cosines(angles)
        fresnel = (1 - cos_d).clamp(0, 1) ** 5
        grazing = (1 - cos_i.clamp(0, 1)) ** 5 + (1 - cos_o.clamp(0, 1)) ** 5
        shape = self._lobe_shapes(alpha, tail, angles, cos_i, cos_o)
        basis = torch.cat(
            (
                shape,
                shape * fresnel,
                torch.stack((fresnel * 0 + 0.1, grazing * 0.1)).expand(n, -1, -1),
            ),
            1,
        )
        order = torch.cat((gains[..., 2:], gains[..., :2]), 2)
        analytic = torch.bmm(order, basis)
        angular = self.basis(self._angular_features(angles, cos_i, cos_o))
        correction = weights[..., 2 + 2 * lobes :] @ angular.T
        correction = 3 * torch.tanh(correction / 3)
        return expand((compress(analytic) + correction).clamp(0, 16.2)).transpose(1, 2)

    @staticmethod
    def _lobe_shapes(
        alpha: Tensor, tail: Tensor, angles: Tensor, cos_i: Tensor, cos_o: Tensor
    ) -> Tensor:
        """[N, lobes, M]: (a^2 / (sin^2 + a^2 cos^2))^tail / a^2 with Smith masking over cosines."""
        a2 = alpha.square()[..., None]
        sin2_h = angles[:, 0].sin().square()
        ratio = a2 / (sin2_h + a2 * (1 - sin2_h))
        shape = torch.exp(tail[..., None] * ratio.log()) / (4 * math.pi * a2)
        for cos in (cos_i.clamp(0, 1), cos_o.clamp(0, 1)):
            shape = (
                shape * 2 / (cos + (cos.square() + a2 * (1 - cos.square())).sqrt().clamp_min(0.02))
            )
        return shape

    @staticmethod
    def _angular_features(angles: Tensor, cos_i: Tensor, cos_o: Tensor) -> Tensor:
        """[M, 8], each symmetric in the two directions."""
        near = (torch.log(angles[:, :1] + 0.003) + 3) * 0.4
        product, total = (cos_i * cos_o)[:, None], (cos_i + cos_o)[:, None]
        fresnel = ((1 - angles[:, 1].cos()) ** 5)[:, None]
        return torch.cat((network_input(angles), near, product, total - 1, fresnel), 1)
