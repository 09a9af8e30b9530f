"""The paper's metric (section 4.2) as docs/design.md pins it: PSNR of a sphere under real light."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from model_runtime.brdf import views
from model_runtime.brdf.half_angle import from_directions

from .radiance import read_radiance

__all__ = ("MAPS", "Sphere", "psnr", "tone_map")

MAPS = ("potsdamer_platz", "studio_small_03", "forest_slope")

Evaluate = Callable[[Tensor], Tensor]


def tone_map(radiance: Tensor) -> Tensor:
    """As pixels are shown, 0 to 1; what is less than nothing is black."""
    return views.tone_map(radiance.clamp_min(0))


def psnr(truth: Tensor, estimate: Tensor) -> Tensor:
    """PSNR in dB of tone-mapped radiance [..., P, 3] over pixels and channels, capped at 100."""
    error = (tone_map(truth) - tone_map(estimate)).square().mean((-1, -2))
    return (-10 * error.clamp_min(1e-10).log10()).clamp_max(100)


def _averaged(path: Path, height: int, width: int) -> np.ndarray:
    """The map at `path`, averaged over blocks to [height, width, 3]."""
    pixels = read_radiance(path)
    rows, columns = pixels.shape[0] // height, pixels.shape[1] // width
    return pixels.reshape(height, rows, width, columns, 3).mean((1, 3))


@dataclass(frozen=True)
class Sphere:
    """An orthographic sphere under environment maps: what each pixel must sum.

    `angles` [P, D, 3] are the half-angle coordinates of every pixel and light direction, `weights`
    [E, P, D, 3] radiance x cosine x solid angle, 0 below the pixel's horizon. The pixels are those
    of `inside` [S, S] in row order, the top row first.
    """

    angles: Tensor
    weights: Tensor
    inside: Tensor

    @classmethod
    def load(cls, hdri: Path, *, pixels: int = 64, height: int = 32, width: int = 64) -> Sphere:
        """Build from the maps of `hdri`, each scaled to mean radiance 1 over the sphere."""
        polar = (torch.arange(height, dtype=torch.float64) + 0.5) * math.pi / height
        turn = (torch.arange(width, dtype=torch.float64) + 0.5) * 2 * math.pi / width
        up = polar.cos()[:, None].expand(height, width)
        flat = polar.sin()[:, None]
        light = torch.stack((flat * turn.sin(), up, -flat * turn.cos()), -1).reshape(-1, 3)
        solid = (flat.expand(height, width) * (math.pi / height) * (2 * math.pi / width)).reshape(
            -1
        )
        radiance = []
        for name in MAPS:
            image = torch.from_numpy(_averaged(hdri / f"{name}_1k.hdr", height, width))
            image = image.reshape(-1, 3)
            mean = (image * solid[:, None]).sum() / (3 * solid.sum())
            radiance.append(image / mean)

        grid = (torch.arange(pixels, dtype=torch.float64) + 0.5) * 2 / pixels - 1
        y, x = torch.meshgrid(-grid, grid, indexing="ij")
        inside = x.square() + y.square() < 1
        x, y = x[inside], y[inside]
        normal = torch.stack((x, y, (1 - x.square() - y.square()).clamp_min(0).sqrt()), -1)
        view = torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64)
        tangent = torch.nn.functional.normalize(
            torch.stack((normal[:, 2], torch.zeros_like(x), -normal[:, 0]), -1), dim=-1
        )
        frame = torch.stack((tangent, torch.linalg.cross(normal, tangent), normal), 1)
        wi = torch.einsum("pij,dj->pdi", frame, light)
        wo = torch.einsum("pij,j->pi", frame, view)[:, None].expand_as(wi)
        cosine = wi[..., 2].clamp_min(0) * solid
        weights = torch.stack(radiance)[:, None] * cosine[None, ..., None]
        return cls(from_directions(wi, wo).float(), weights.float(), inside)

    def render(self, evaluate: Evaluate, *, chunk: int = 4) -> Tensor:
        """Radiance [N, E, P, 3] of N uniform materials: `evaluate`(angles [M, 3]) -> f [N, M, 3].

        Half a turn about the line of sight maps the pixels and the light's directions onto
        themselves, in reverse order: every f serves two pixels. `chunk` pixels are held at once.
        """
        maps, count = self.weights.shape[:2]
        half = (count + 1) // 2
        parts = []
        for start in range(0, half, chunk):
            stop = min(start + chunk, half)
            here, there = slice(start, stop), slice(count - stop, count - start)
            weights = torch.cat((self.weights[:, here], self.weights[:, there].flip(1, 2)))
            parts.append(torch.einsum("npdc,epdc->nepc", self._reflected(evaluate, here), weights))
        near, far = torch.cat(parts, 2).split(maps, 1)
        return torch.cat((near, far.flip(2)[:, :, 2 * half - count :]), 2)

    def render_textured(
        self, evaluate: Callable[[Tensor, Tensor], Tensor], texels: Tensor
    ) -> Tensor:
        """Radiance [1, E, P, 3] of a sphere whose pixels show BRDFs `texels` [P]:
        `evaluate`(rows [1], angles [M, 3]) -> f [1, M, 3].
        """
        radiance = self.weights.new_empty(len(self.weights), len(texels), 3)
        for row in texels.unique():
            pixels = (texels == row).nonzero()[:, 0]
            f = self._reflected(lambda angles, row=row: evaluate(row[None], angles), pixels)
            radiance[:, pixels] = torch.einsum("pdc,epdc->epc", f[0], self.weights[:, pixels])
        return radiance[None]

    def _reflected(self, evaluate: Evaluate, pixels: slice | Tensor) -> Tensor:
        """f [N, p, D, 3] towards the viewer at `pixels` from every direction, 0 from below."""
        lit = self.weights[:, pixels].amax((0, -1)) > 0
        f = evaluate(self.angles[pixels][lit])
        spread = f.new_zeros(len(f), *lit.shape, 3)
        spread[:, lit] = f
        return spread
