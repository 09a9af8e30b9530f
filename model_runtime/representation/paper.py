"""The paper's BRDF encoder and decoder (section 3.1, figure 3), and the same without its split."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..backend import Tensor, functional, nn, torch
from ..brdf import torrance_sparrow
from ..brdf.half_angle import above_horizon, network_input
from ..channels import optics
from .latents import Latents, inverse_log_transform, log_transform

__all__ = ("JointRepresentation", "PaperConfig", "PaperRepresentation")


_PARAMETRIC_SAMPLES = 256


@dataclass(frozen=True)
class PaperConfig:
    """Section 4.1: d_w = 64 and d_z = 7; heads and layers as in the published code."""

    width: int = 64
    shared_latents: int = 7
    heads: int = 8
    blocks: int = 1
    decoder_width: int = 128
    decoder_layers: int = 6


class _Attention(nn.Module):
    """Multi-head attention with a residual MLP, both behind layer normalization."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.before, self.between = nn.LayerNorm(width), nn.LayerNorm(width)
        self.query, self.key_value = nn.Linear(width, width), nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)
        self.mlp = nn.Sequential(nn.Linear(width, width), nn.GELU(), nn.Linear(width, width))

    def forward(self, queries: Tensor, tokens: Tensor) -> Tensor:
        """`queries` [..., q, w] attend to `tokens` [..., t, w]."""
        keys, values = self.key_value(self.before(tokens)).chunk(2, -1)
        asked = self.query(self.before(queries))
        split = [x.unflatten(-1, (self.heads, -1)).transpose(-2, -3) for x in (asked, keys, values)]
        mixed = functional.scaled_dot_product_attention(*split).transpose(-2, -3).flatten(-2)
        queries = queries + self.out(mixed)
        return queries + self.mlp(self.between(queries))


class PaperRepresentation(nn.Module):
    """Self-attention over the color channels of each sample, class attention, mean over samples.

    `encode` gives z_RGB (color, [N, 3, 1]: the channel medians of l(reflectance)) and the mean of
    z_BRDF (shared, [N, 7]). While training, z_BRDF is drawn from the normal distribution that the
    encoder estimates.
    """

    name = "paper"
    color_latents = 1
    channels_together = 1

    def __init__(self, config: PaperConfig = PaperConfig()) -> None:
        super().__init__()
        self.config = config
        width = config.width
        self.embed = nn.Linear(self.channels_together + 4, width)
        self.self_attention = nn.ModuleList(
            _Attention(width, config.heads) for _ in range(config.blocks)
        )
        self.class_token = nn.Parameter(torch.zeros(width))
        self.class_attention = _Attention(width, config.heads)
        self.to_normal = nn.Sequential(
            nn.Linear(width, 128), nn.GELU(), nn.Linear(128, 2 * config.shared_latents)
        )
        inputs = sum(self.latent_sizes) + 4
        hidden = config.decoder_width
        self.decoder = nn.ModuleList(
            nn.Linear(inputs if i == 0 else hidden + inputs, hidden)
            for i in range(config.decoder_layers)
        )
        self.to_color = nn.Linear(hidden, 3)

    @property
    def latent_sizes(self) -> tuple[int, int]:
        """Numbers for the three channels together, and shared ones."""
        return 3 * self.color_latents, self.config.shared_latents

    def sample_angles(self, m: int, *, measured: bool = False) -> Tensor:
        """The first `m` of a fixed sequence of directions [m, 3] above the horizon."""
        g = torch.Generator().manual_seed(0)
        u = torch.rand(2 * m + 64, 3, generator=g)
        angles = torch.stack(
            (u[:, 0] ** 2 * math.pi / 2, u[:, 1] * math.pi / 2, u[:, 2] * 2 * math.pi), 1
        )
        return angles[above_horizon(angles)][:m]

    def encode(self, angles: Tensor, f: Tensor) -> Latents:
        """Latents of `f` [N, M, 3] at any `angles` [M, 3]."""
        values = log_transform(f.clamp_min(0))
        color = values.median(1).values[..., None][..., : self.color_latents]
        sets = values.unflatten(-1, (-1, self.channels_together))
        placed = network_input(angles)[None, :, None].expand(*sets.shape[:3], 4)
        tokens = self.embed(torch.cat((sets, placed), -1))
        for block in self.self_attention:
            tokens = block(tokens, tokens)
        token = self.class_token.expand(*tokens.shape[:2], 1, -1)
        feature = self.class_attention(token, torch.cat((token, tokens), 2))[:, :, 0].mean(1)
        mean, log_variance = self.to_normal(feature).chunk(2, -1)
        if self.training:
            mean = mean + torch.randn_like(mean) * (0.5 * log_variance.clamp(-20, 4)).exp()
        return Latents(color, mean)

    def encode_parameters(self, states: Tensor) -> Latents:
        """Latents of Torrance-Sparrow materials `states` [N, C], sampled."""
        angles = self.sample_angles(_PARAMETRIC_SAMPLES)
        return self.encode(angles, torrance_sparrow.evaluate(*optics(states), angles))

    def decode(self, latents: Latents, angles: Tensor) -> Tensor:
        """f [N, M, 3] at `angles` [M, 3]."""
        n, m = len(latents.shared), len(angles)
        given = torch.cat((latents.color.flatten(1), latents.shared), 1)
        given = torch.cat(
            (given[:, None].expand(n, m, -1), network_input(angles).expand(n, m, -1)), -1
        )
        hidden = functional.gelu(self.decoder[0](given))
        for layer in self.decoder[1:]:
            hidden = functional.gelu(layer(torch.cat((hidden, given), -1)))
        return inverse_log_transform(functional.softplus(self.to_color(hidden), beta=20))


class JointRepresentation(PaperRepresentation):
    """The paper's ablation, BRDFNPs (Zheng et al. 2021, as section 4.4 uses it): no split.

    Each sample is one token of its three reflectances and its angles, and all latents are shared:
    10, as many as the paper's 3 + 7, so that only the split differs.
    """

    name = "brdfnps"
    color_latents = 0
    channels_together = 3

    def __init__(self, config: PaperConfig = PaperConfig(shared_latents=10)) -> None:
        super().__init__(config)
