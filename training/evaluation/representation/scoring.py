"""Spheres of materials as the truth and as a method has them, and how far they are apart."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from model_runtime.representation.paper import PaperRepresentation

from ...metric.sphere import MAPS, Sphere, psnr, tone_map
from ..bench.kept import identity, keep, read_kept
from .sets import Evaluate, Materials

__all__ = ("SHOWN", "Outcome", "score", "show", "truth")

SHOWN = MAPS.index("potsdamer_platz")
"""The environment map that pictures are made under."""

_PROBES = 64


@dataclass(frozen=True)
class Outcome:
    """By name of a material or frame: PSNR in dB, averaged over the maps, and tone-mapped pixels
    [P, 3] under the map that is shown.
    """

    scores: dict[str, float]
    pictures: dict[str, Tensor]


def truth(sphere: Sphere, materials: Materials) -> Tensor:
    """Radiance [n, E, P, 3] of uniform materials, [1, E, P, 3] of a frame."""
    return _render(sphere, materials, materials.evaluate)


def show(materials: Materials, radiance: Tensor) -> dict[str, Tensor]:
    """Pictures by name; half precision, as many are kept."""
    pixels = tone_map(radiance[:, SHOWN]).half()
    return dict(zip(materials.names, pixels, strict=True))


def score(
    sphere: Sphere, materials: Materials, radiance: Tensor, evaluate: Evaluate, path: Path
) -> Outcome:
    """Compare what `evaluate` makes of `materials` with their true `radiance`.

    The outcome is kept at `path` and read there as long as the truth and the values that `evaluate`
    gives at a few directions are the same to the bit: rendering is what takes long.
    """
    angles = PaperRepresentation().sample_angles(_PROBES)
    made_from = identity(radiance, evaluate(torch.arange(materials.n), angles))
    kept = read_kept(path, made_from)
    if kept is None:
        estimate = _render(sphere, materials, evaluate)
        pictures = torch.stack(list(show(materials, estimate).values()))
        kept = {"scores": psnr(radiance, estimate).mean(1), "pictures": pictures}
        keep(path, kept, made_from)
    names = materials.names
    return Outcome(
        dict(zip(names, kept["scores"].tolist(), strict=True)),
        dict(zip(names, kept["pictures"], strict=True)),
    )


def _render(sphere: Sphere, materials: Materials, evaluate: Evaluate) -> Tensor:
    if materials.texels is not None:
        return sphere.render_textured(evaluate, materials.texels)
    rows = torch.arange(materials.n)
    return sphere.render(lambda angles: evaluate(rows, angles))
