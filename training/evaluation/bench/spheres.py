"""The sphere of the metric for textures that change: what hundreds of thousands of pictures need.

A pixel of the sphere sees one texel from one side, so under Torrance-Sparrow it shows

    radiance = Kd / pi E + Ks S(alpha)

with E and S(alpha) sums over the map that belong to the pixel alone. S is tabulated once over
log alpha; a picture is then a look-up, not two million evaluations of a BRDF. BRDFs that only a
decoder knows are rendered directly, on few of the pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from model_runtime.brdf.torrance_sparrow import specular_lobe
from model_runtime.channels import ALPHA_MIN, optics

from ...metric.sphere import MAPS, Sphere, tone_map
from .kept import identity, kept

__all__ = ("SHOWN", "TexturedSphere", "picture")

SHOWN = MAPS.index("potsdamer_platz")
"""The environment map that pictures are made under."""

_ALPHAS = 128

Decode = Callable[[int, Tensor], Tensor]
"""(place among the pixels, angles [M, 3]) -> f [T, M, 3] of that pixel's texel at T times."""


def picture(radiance: Tensor) -> Tensor:
    """Tone-mapped pixels [N, P, 3] of radiance [N, E, P, 3] under the map that is shown; half
    precision, as many are kept.
    """
    return tone_map(radiance[:, SHOWN]).half()


@dataclass(frozen=True)
class TexturedSphere:
    """A sphere under E maps whose P pixels show a texel each.

    diffuse: [P, E, 3] and specular: [K, P, E, 3], the latter log S at alphas evenly spaced in
    their logarithm. few: the pixels, evenly spread, on which dear methods are scored.
    """

    sphere: Sphere
    diffuse: Tensor
    specular: Tensor
    few: Tensor

    @classmethod
    def load(
        cls,
        hdri: Path,
        *,
        pixels: int,
        stride: int,
        folder: Path,
        height: int = 32,
        width: int = 64,
    ) -> TexturedSphere:
        """A sphere `pixels` wide under maps of `height` x `width` directions; of its rows and
        columns every `stride`-th is among the few. The table is kept in `folder`.
        """
        sphere = Sphere.load(hdri, pixels=pixels, height=height, width=width)
        made_from = identity(sphere.weights, f"{_ALPHAS}")
        path = folder / f"sphere_{pixels}.safetensors"
        table = kept(path, made_from, lambda: _table(sphere))
        row, column = sphere.inside.nonzero().T
        few = (row % stride == stride // 2) & (column % stride == stride // 2)
        return cls(sphere, table["diffuse"], table["specular"], few.nonzero()[:, 0])

    def texels(self, height: int, width: int) -> Tensor:
        """The texel (in row order) that each pixel [P] shows of a texture wrapped over the sphere:
        one a pixel where the texture is as wide as the sphere, else the nearest.
        """
        side = len(self.sphere.inside)
        row, column = self.sphere.inside.nonzero().T
        return (2 * row + 1) * height // (2 * side) * width + (2 * column + 1) * width // (2 * side)

    def render(self, states: Tensor, pixels: Tensor | None = None) -> Tensor:
        """Radiance [T, E, p, 3] of Torrance-Sparrow `states` [T, p, C] that can be rendered, at
        `pixels` [p] (all by default).
        """
        chosen = torch.arange(states.shape[1]) if pixels is None else pixels
        kd, ks, alpha = optics(states)
        lobes = torch.stack([self._specular(a, chosen) for a in alpha])
        radiance = kd[:, :, None] * self.diffuse[chosen] + ks[:, :, None] * lobes
        return radiance.transpose(1, 2)

    def render_decoded(self, decode: Decode, pixels: Tensor) -> Tensor:
        """Radiance [T, E, p, 3] of any BRDFs at `pixels` [p]."""
        parts = []
        for place, pixel in enumerate(pixels.tolist()):
            weights = self.sphere.weights[:, pixel]
            lit = weights.amax((0, -1)) > 0
            f = decode(place, self.sphere.angles[pixel][lit])
            parts.append(torch.einsum("tmc,emc->tec", f, weights[:, lit]))
        return torch.stack(parts, 2)

    def _specular(self, alpha: Tensor, pixels: Tensor) -> Tensor:
        """S [p, E, 3] for one alpha [p] a pixel: a cubic (Catmull-Rom) through the logarithms."""
        place = (alpha.clamp_min(ALPHA_MIN).log() / math.log(ALPHA_MIN) - 1).neg() * (_ALPHAS - 1)
        lower = place.floor().clamp(0, _ALPHAS - 2)
        u = (place - lower).clamp(0, 1)
        weights = (
            ((2 - u) * u - 1) * u / 2,
            ((3 * u - 5) * u * u + 2) / 2,
            ((4 - 3 * u) * u + 1) * u / 2,
            (u - 1) * u * u / 2,
        )
        total = torch.zeros_like(self.diffuse[pixels])
        for offset, weight in zip((-1, 0, 1, 2), weights, strict=True):
            index = (lower.long() + offset).clamp(0, _ALPHAS - 1)
            total += weight[:, None, None] * self.specular[index, pixels]
        return total.exp()


def _table(sphere: Sphere) -> dict[str, Tensor]:
    """`diffuse` and `specular` of a sphere."""
    alpha = torch.logspace(math.log10(ALPHA_MIN), 0, _ALPHAS)
    diffuse, specular = [], []
    for pixel in range(len(sphere.angles)):
        weights = sphere.weights[:, pixel]
        lit = weights.amax((0, -1)) > 0
        lit_weights = weights[:, lit]  # [E, M, 3]
        diffuse.append(lit_weights.sum(1) / math.pi)
        lobes = specular_lobe(alpha, sphere.angles[pixel][lit])  # [K, M]
        specular.append(torch.einsum("km,emc->kec", lobes, lit_weights).clamp_min(1e-20).log())
    return {"diffuse": torch.stack(diffuse), "specular": torch.stack(specular, 1)}
