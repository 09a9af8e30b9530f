"""How far one texture looks from another: statistics of what a network that sees makes of them.

Two pictures of one material agree in no texel, so nothing is compared texel by texel. What a
network that was trained to see (VGG16, Simonyan and Zisserman 2014) finds in each place of a
picture is a cloud of points; two textures are as far apart as their clouds (the sliced Wasserstein
distance of Heitz et al. 2021): along each of some directions, sorted values are subtracted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.torch import load_file
from torch import Tensor
from torch.nn import functional

from model_runtime.errors import InputError

__all__ = ("LAYERS", "Seen", "TextureMetric", "Textures", "encoded")

LAYERS = ("pixels", "conv1_2", "conv2_2", "conv3_3", "conv4_3")

_CONVOLUTIONS = 10
_KEPT = (1, 3, 6, 9)  # of which the features are compared
_POOLED = (1, 3, 6)
_MEAN, _SPREAD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
_DIRECTIONS = 64
_LEVELS = 1024  # quantiles compared along each direction
_MOST = 1 << 16  # places of a layer that are looked at: as many, at random, tell the same

Pixels = NDArray[np.float32]


def encoded(color: Pixels) -> Pixels:
    """Linear colors as the sRGB, 0 to 1, that pictures are compared in."""
    color = color.clip(0, 1)
    return np.where(color <= 0.0031308, 12.92 * color, 1.055 * color ** (1 / 2.4) - 0.055).astype(
        np.float32
    )


@dataclass(frozen=True)
class Seen:
    """Values of one or more pictures along each layer's directions, sorted: [layer][64, levels],
    with their mean [64, 1] and mean square [64, 1], of the values themselves.
    """

    quantiles: tuple[Tensor, ...]
    mean: tuple[Tensor, ...]
    square: tuple[Tensor, ...]


@dataclass(frozen=True)
class Textures:
    """Distances by layer, and their mean: 0 for the same, about 1 for a flat color."""

    layers: tuple[float, ...]

    @property
    def distance(self) -> float:
        return sum(self.layers) / len(self.layers)


@dataclass(frozen=True)
class TextureMetric:
    """The network's `weights`, and the `directions` [layer][C, 64] that its features are seen
    along.
    """

    weights: Sequence[tuple[Tensor, Tensor]]
    directions: Sequence[Tensor]

    @classmethod
    def load(cls, perceptual: Path) -> TextureMetric:
        """From the data folder's `perceptual`; InputError where it is not there."""
        try:
            stored = load_file(perceptual / "vgg16_relu4_3.safetensors")
        except OSError as error:
            raise InputError(
                f"{perceptual} lacks the weights of VGG16.", "Copy the data folder again."
            ) from error
        weights = [
            (stored[f"conv{i}.weight"].float(), stored[f"conv{i}.bias"].float())
            for i in range(_CONVOLUTIONS)
        ]
        g = torch.Generator().manual_seed(0)
        widths = (3, *(len(weights[i][1]) for i in _KEPT))
        directions = (torch.randn(width, _DIRECTIONS, generator=g) for width in widths)
        return cls(weights, [each / each.norm(dim=0) for each in directions])

    @torch.no_grad()
    def seen(self, picture: Pixels) -> Seen:
        """What a picture [H, W, 3] (sRGB, 0 to 1) shows."""
        parts = []
        colors = torch.from_numpy(np.ascontiguousarray(picture, np.float32)).permute(2, 0, 1)
        for layer, features in enumerate(self.features(colors)):
            values = features.flatten(1)
            if values.shape[1] > _MOST:
                g = torch.Generator().manual_seed(layer)
                values = values[:, torch.randperm(values.shape[1], generator=g)[:_MOST]]
            values = self.directions[layer].T @ values
            levels = (torch.arange(_LEVELS) + 0.5) / _LEVELS * values.shape[1]
            ordered = values.sort(1).values[:, levels.long()]
            mean, square = (x.mean(1, keepdim=True) for x in (values, values.square()))
            parts.append((ordered, mean, square))
        return Seen(*zip(*parts, strict=True))

    def distance(self, first: Seen, second: Seen) -> Textures:
        """The mean difference along each direction, in standard deviations of both together."""
        layers = []
        for layer in range(len(LAYERS)):
            apart = (first.quantiles[layer] - second.quantiles[layer]).abs().mean(1)
            mean = (first.mean[layer] + second.mean[layer]) / 2
            square = (first.square[layer] + second.square[layer]) / 2
            spread = (square - mean.square()).clamp_min(0).sqrt()[:, 0]
            layers.append(float((apart / spread.clamp_min(1e-6)).mean()))
        return Textures(tuple(layers))

    def features(self, colors: Tensor) -> list[Tensor]:
        """[C, h, w] of each layer, with slopes, of a picture `colors` [3, H, W] (sRGB)."""
        x = (colors - torch.tensor(_MEAN)[:, None, None]) / torch.tensor(_SPREAD)[:, None, None]
        found, x = [colors], x[None]
        for i, (weight, bias) in enumerate(self.weights):
            x = functional.conv2d(x, weight, bias, padding=1).relu()
            if i in _KEPT:
                found.append(x[0])
            if i in _POOLED:
                x = functional.max_pool2d(x, 2)
        return found
