"""The residue of a sequence that is a picture: what weathered texels have beyond their history."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from model_runtime.temporal.models import Affine

from ..data.sequences import Sequence
from .distance import smoothed
from .histories import align
from .quilting import quilted

__all__ = ("with_residue",)

_LEAST_SIDE = 64  # texels of what can be a picture
_MOST_SIDE = 512
_ALIKE = 0.3  # correlation of neighbors in one
_EARLY = 0.5  # share of texels that start first: weathered as far as can be seen
_REGION = 2.0  # texels over which that is told


def with_residue(sequence: Sequence, *, seed: int = 0) -> Sequence:
    """`sequence` with the residue of its last frame as a tile that wraps, where it brings none and
    its texels lie beside each other as in a picture; else as it is.
    """
    height, width = sequence.alpha.shape[1:]
    if sequence.residue is not None or min(height, width) < _LEAST_SIDE:
        return sequence
    last = sequence.clamped().states()[-1]
    if _alike(last) < _ALIKE:
        return sequence
    onset = np.zeros((height, width), np.float32) if sequence.onset is None else sequence.onset
    early = smoothed(onset, _REGION, (False, False))
    early = early <= np.quantile(early, _EARLY)
    states = torch.from_numpy(sequence.clamped().states())
    histories, observed = align(states.flatten(1, 2), sequence.times, onset.ravel())
    affine = Affine.fit(histories, observed)
    expected = (affine.gain[-1] * states[0] + affine.offset[-1]).numpy()
    residue = np.zeros((height, width, 8), np.float32)
    residue[..., :6] = last[..., :6] - expected[..., :6]
    residue[..., 6] = np.sqrt(last[..., 6]) - np.sqrt(expected[..., 6].clip(0, 1))
    side = min(_MOST_SIDE, height, width)
    tile = quilted(residue, early, (False, False), side, seed)
    tile -= tile.mean((0, 1))
    return replace(sequence, residue=tile, share=side / max(height, width))


def _alike(states: np.ndarray) -> float:
    """The correlation of neighbors in lightness."""
    light = states[..., :6].sum(-1)
    light = light - light.mean()
    return float((light[:, 1:] * light[:, :-1]).mean() / max(float(light.var()), 1e-12))
