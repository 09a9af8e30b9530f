"""Whether a source can be learned from as it is: few frames, gaps, flicker, frames that stand out.

A model of change that holds every frame of its source holds what is wrong with them, too, and
held-out texels share it: cross-validation does not see it. So it is looked for here. Frames that
stand out are dropped and unsteady light is evened out; what was found is said in the model's card,
and by `age` whenever it is used.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from model_runtime.states import perceptual

from ..data.sequences import MixtureSequence, Sequence

__all__ = ("evened_out", "flicker", "frames_that_stand_out", "steadied", "widest_gap")

_TEXELS = 1024
_FEWEST_FRAMES = 6
_GAP = 0.15  # of the sequence's time without a frame
_UNEVEN = 3.0  # times as long as usual
_FLICKER = 0.02  # of the brightness
_FRAMES_OF_A_CURVE = 16
_NORMAL = 1.4826  # standard deviations of a normal number in its median
_COUNTS = 1.4
_BLACK = 1e-6
_STANDS_OUT = (3.0, 0.05)
_MOST_DROPPED = 0.1
_BY_FRAME = ("kd", "ks", "alpha", "times", "height", "strength")


def steadied(sequence: Sequence | MixtureSequence) -> Sequence | MixtureSequence:
    """`sequence` without the frames that stand out, its light evened out where it flickers, and
    with `warnings` that say what of it a model cannot be sure of. Mixtures, which have no frames of
    their own, are returned as they are.
    """
    if isinstance(sequence, MixtureSequence):
        return sequence
    warnings: list[str] = []
    dropped = frames_that_stand_out(sequence)
    if dropped:
        numbers = ", ".join(str(frame + 1) for frame in dropped)
        warnings.append(f"Frame {numbers} stood out from those around and was left out.")
        kept = np.setdiff1d(np.arange(len(sequence.times)), dropped)
        parts = {name: getattr(sequence, name) for name in _BY_FRAME}
        sequence = replace(
            sequence, **{name: part[kept] for name, part in parts.items() if part is not None}
        )
    frames = len(sequence.times)
    if frames < _FEWEST_FRAMES:
        warnings.append(f"There were only {frames} frames: what happens between them is a guess.")
    gap = widest_gap(sequence.times)
    if gap > _GAP and gap > _UNEVEN * (sequence.times[-1] - sequence.times[0]) / (frames - 1):
        warnings.append(f"There were no frames for {gap:.0%} of the time: that part is a guess.")
    strength = flicker(sequence)
    if strength > _FLICKER:
        sequence = evened_out(sequence)
        warnings.append(
            f"The light flickered (by {strength:.0%} of its brightness). It was evened out, but "
            "how bright the material is at any time is a guess."
        )
    return replace(sequence, warnings=(*sequence.warnings, *warnings))


def frames_that_stand_out(sequence: Sequence) -> list[int]:
    """Frames, counted from 0, that most texels leave their way for: at least three times as far
    from the line between their neighbors as those are from each other.

    Where more than a tenth of the frames would (or more than one, if that is less), none does: that
    is flicker. The first and the last frame, which have one neighbor, are taken as they are.
    """
    states = _shown(sequence)
    if len(states) < 3:
        return []
    share = torch.from_numpy(
        (sequence.times[1:-1] - sequence.times[:-2]) / (sequence.times[2:] - sequence.times[:-2])
    )
    line = torch.lerp(states[:-2], states[2:], share[:, None, None])
    away = (states[1:-1] - line).norm(dim=-1).median(1).values
    apart = (states[2:] - states[:-2]).norm(dim=-1).median(1).values
    far, least = _STANDS_OUT
    found = (away > far * apart + least).nonzero()[:, 0] + 1
    return found.tolist() if len(found) <= max(1, _MOST_DROPPED * len(states)) else []


def flicker(sequence: Sequence) -> float:
    """How unsteady the light is: by how much of its brightness the picture's mean over texels, Kd
    and Ks together, usually is off a smooth curve (the standard deviation, from the median, so that
    one sudden change does not count). 0 for fewer than 16 frames, which show no such curve.
    """
    if len(sequence.times) < _FRAMES_OF_A_CURVE:
        return 0.0
    return _NORMAL * float(np.median(np.abs(_unsteady(sequence))))


def evened_out(sequence: Sequence) -> Sequence:
    """`sequence` with Kd and Ks of each frame divided by how much brighter it is, in the mean over
    texels, than its time's place on a smooth curve through all frames.
    """
    light = np.exp(_unsteady(sequence)).astype(np.float32)[:, None, None, None]
    return replace(sequence, kd=sequence.kd / light, ks=sequence.ks / light)


def _unsteady(sequence: Sequence) -> NDArray[np.float64]:
    """The logarithm of each frame's brightness, less what is smooth of it: [T]."""
    clamped = sequence.clamped()
    mean = (clamped.kd + clamped.ks).mean((1, 2, 3), dtype=np.float64)
    brightness = np.log(np.maximum(mean, _BLACK))
    return brightness - _smooth(brightness)


def _smooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The curve z that minimizes |values - z|^2 + s |second differences of z|^2 (Whittaker 1923),
    with s chosen by generalized cross-validation in which each degree of freedom counts 1.4 times,
    so that noise is not taken for the curve (Kim and Gu 2004).
    """
    count = len(values)
    bend = np.diff(np.eye(count), 2, axis=0)
    best, curve = np.inf, values
    for strength in np.logspace(-2, 6, 33):
        smoother = np.linalg.inv(np.eye(count) + strength * bend.T @ bend)
        found = smoother @ values
        free = count - _COUNTS * smoother.trace()
        left = np.square(values - found).sum() / free**2
        if free > 0 and left < best:
            best, curve = left, found
    return curve


def widest_gap(times: NDArray[np.float32]) -> float:
    """The longest time between two frames, as a share of the whole."""
    return float(np.diff(times).max() / (times[-1] - times[0]))


def _shown(sequence: Sequence) -> Tensor:
    """Perceptual states [T, n, C] of at most 1,024 texels, evenly spaced in row order."""
    states = sequence.clamped().states()
    states = states.reshape(len(states), -1, states.shape[-1])
    states = states[:, :: max(1, states.shape[1] // _TEXELS)]
    return perceptual(torch.from_numpy(states).flatten(0, 1)).unflatten(0, states.shape[:2])
