"""Grain from an example: what a source's weathered texels have beyond their mean, as components.

A residue [S, S, 8] is decorrelated in steps that look about alike, its strongest components are
brought to a Gaussian histogram by their ranks (so that patches of them can be blended), and a
table each leads back. What a component adds to a texel grows with its age as the source's texels
come to differ.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from model_runtime.temporal.grain import MOST_COMPONENTS, Grain
from model_runtime.temporal.models import Affine

from ..data.sequences import Sequence
from .histories import align

__all__ = ("grain_of", "grain_of_sequence", "height_of")

Array = NDArray[np.float32]

_LEVELS = 256
_GAUSSIAN = 4.0
_DARKEST = 0.004  # reflectance from which on the eye's steps are counted
_HEIGHT = 0.5  # how much the relief counts among what is seen
_LEFT_OUT = 0.003  # share of what is seen that may be missing
_BEYOND = 0.001  # share of texels at each end of a channel that count as the last before them
_FINE = 4096


def grain_of(residue: Array, mean: Array, strength: Array, share: float) -> Grain:
    """The grain of `residue` [S, S, 8] (of kd, ks, r and height) around a `mean` [7] of kd, ks and
    r. `strength` [T], 0 at first, says how much of it shows at each age; a tile of it covers
    `share` of a material's side.
    """
    side = len(residue)
    flat = residue.reshape(-1, residue.shape[-1]).astype(np.float64)
    flat = flat.clip(*np.quantile(flat, (_BEYOND, 1 - _BEYOND), 0))
    flat -= flat.mean(0)
    weight = _weights(flat, mean)
    values, axes = np.linalg.eigh(np.cov((flat * weight).T))
    values = np.maximum(values[::-1], 0)
    missing = values.sum() - np.cumsum(values)
    count = min(int((missing > _LEFT_OUT * values.sum()).sum()) + 1, MOST_COMPONENTS)
    axes, deviation = axes[:, ::-1][:, :count], np.sqrt(values[:count])
    tile, table = zip(*map(_gaussian, ((flat * weight) @ axes).T), strict=True)
    shapes = (deviation * axes).T / weight  # [K, 8]
    return Grain(
        np.stack(tile).reshape(count, side, side),
        np.stack(table),
        (strength[:, None, None] * shapes).astype(np.float32),
        share,
    )


def grain_of_sequence(sequence: Sequence) -> Grain | None:
    """The grain of a sequence that brings a residue; None where it brings none."""
    if sequence.residue is None:
        return None
    last = sequence.clamped().states()[-1].reshape(-1, 7)
    mean = np.concatenate((last[:, :6].mean(0), np.sqrt(last[:, 6:]).mean(0)))
    strength = sequence.strength
    if strength is None:
        states = torch.from_numpy(sequence.states())
        histories, observed = _aligned(sequence, states)
        gain = Affine.fit(histories, observed).gain.mean(1)
        strength = (1 - gain).clamp(0, 1).numpy()
    return grain_of(
        sequence.residue, mean, np.where(np.arange(len(strength)), strength, 0), sequence.share
    )


def height_of(sequence: Sequence) -> Tensor | None:
    """The mean height [T] at ages evenly spaced from 0 to 1, 0 at first; None where nothing is
    known of it.
    """
    if sequence.height is None:
        return None
    histories, observed = _aligned(sequence, torch.from_numpy(sequence.height)[..., None])
    weight = observed.float()
    height = (histories[..., 0] * weight).sum(0) / weight.sum(0).clamp_min(1)
    return height - height[0]


def _aligned(sequence: Sequence, values: Tensor) -> tuple[Tensor, Tensor]:
    """Histories [N, T, D] of `values` [T, H, W, D], counted from onset, and where observed."""
    flat = values.flatten(1, 2)
    onset = np.zeros(flat.shape[1]) if sequence.onset is None else sequence.onset.ravel()
    return align(flat, sequence.times, onset)


def _weights(flat: NDArray[np.float64], mean: Array) -> NDArray[np.float64]:
    """What a step of each channel [8] looks like: square roots of reflectances, r as it is, and
    height so that it counts half as much as all else.
    """
    weight = np.ones(flat.shape[1])
    weight[:6] = 0.5 / np.sqrt(np.maximum(mean[:6], _DARKEST))
    looks = np.sqrt(np.square(flat[:, :7] * weight[:7]).sum(1).mean())
    rise = float(flat[:, 7].std())
    weight[7] = _HEIGHT * looks / rise if rise > 0 and looks > 0 else 1.0
    return weight


def _gaussian(values: NDArray[np.float64]) -> tuple[NDArray[np.uint8], Array]:
    """Values [n] as bytes of a Gaussian histogram, and the table [256] that leads back, of zero
    mean and unit variance. Values that are all alike have a table of zeros.
    """
    order = np.argsort(values, kind="stable")
    shares = np.empty(len(values))
    shares[order] = (np.arange(len(values)) + 0.5) / len(values)
    fine = np.linspace(-_GAUSSIAN, _GAUSSIAN, _FINE)
    below = np.array([0.5 * math.erfc(-g / math.sqrt(2)) for g in fine])
    gaussian = np.interp(shares, below, fine)
    stored = np.rint((gaussian / _GAUSSIAN + 1) / 2 * 255).astype(np.uint8)
    levels = np.linspace(-_GAUSSIAN, _GAUSSIAN, _LEVELS)
    places = (np.arange(len(values)) + 0.5) / len(values)
    table = np.interp(np.interp(levels, fine, below), places, values[order])
    found = table[stored]
    deviation = float(found.std())
    table = (table - found.mean()) / deviation if deviation > 1e-12 else np.zeros(_LEVELS)
    return stored, np.maximum.accumulate(table).astype(np.float32)
