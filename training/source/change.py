"""What a source shows of a change, and the sequence of many materials that change likewise.

A source (a scan, a time-lapse) shows one material's mean history, how far along it is at each age,
and how its texels differ. What covers a material leaves nothing of it, what alters it keeps its
figure:

    x(a) = (1 - u(a)) x0 + o(a),   o(a) = m(a) - (1 - u(a)) m(0),   u = (1 - kept) s(a)

with m the mean history, s the share of the way that is gone and `kept` the share of a material's
own differences that outlive it: affine in x0, and m itself for the source's own mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model_runtime.channels import ALPHA_MIN
from model_runtime.temporal.onset import rate_map
from model_runtime.temporal.pace import Timing
from model_runtime.temporal.processes import growth_of

from ..data.sequences import Sequence, uniform_times
from ..data.weathering import initial_values
from ..data.weathering_materials import KNOWN
from .pattern import waves_of

__all__ = ("Change", "kept_by", "sequence_of")

Array = NDArray[np.float32]

_KEPT = {"weathered_wood": 0.45, "soiling": 0.15, "drying": 0.6, "fading": 0.8, "yellowing": 0.8}
"""Share of a material's own differences that outlive a process which alters rather than covers:
one scan cannot tell, as it does not show what its weathered texels were before."""

_OWN = 32  # texels a side of the source's own clean ones
_OTHERS = 40  # and of the patchwork of materials that the process may meet
_SOONER, _LATE, _CLOSER = 0.95, 0.745, 0.4
"""What starts last, closely one after the other, has time to weather as far as its source did."""

_SHARES = 1025
_PATTERN = 128  # texels a side of the pattern that tells the statistics of the rates


@dataclass(frozen=True)
class Change:
    """What a source shows.

    mean: [T, 8] kd, ks, r = sqrt(alpha) and height (in sides of the grain's tile, 0 at first) at
        ages evenly spaced from 0 to 1
    gone: [T] share of the way from the first state to the last, 0 to 1, rising
    strength: [T] how much its texels differ beyond what is left of their beginnings, in units of
        what they differ by at the end: 0 at first
    starts: [n, 7] kd, ks and r of clean texels
    residue: [S, S, 8] what weathered texels have beyond their mean, as a tile that wraps
    share: of a material tile's side that the residue's covers
    has_height: whether anything is known of its relief
    weathered: [H, W] what of the source has weathered when half has, or when it was scanned; None:
        nothing is known of its pattern
    scale: the length at which its onsets are half alike, in longer sides of that map
    extent: of a material tile's side that the map covers
    name: of the source
    told: sentences about what was found and what was assumed
    warnings: sentences about what cannot be learned from it for sure
    """

    mean: Array
    gone: Array
    strength: Array
    starts: Array
    residue: Array
    share: float
    has_height: bool
    scale: float
    weathered: NDArray[np.bool_] | None
    name: str
    told: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    extent: float = 1.0


def kept_by(process: str) -> float:
    """The share of a material's own differences that outlive `process`: 0 where it covers all."""
    return _KEPT.get(process, 0.0)


def sequence_of(
    change: Change, *, process: str = "", sources: tuple[Mapping[str, str], ...] = (), seed: int = 0
) -> Sequence:
    """Materials that change as `change` shows: the source's own clean texels and, where `process`
    is known, a patchwork of others that it may meet, all from their onset at time 0 on; with the
    source's height and residue, and the pace of `process` at the source's scale.
    """
    rng = np.random.default_rng((seed, 16))
    starts = change.starts[rng.integers(0, len(change.starts), _OWN * _OWN)]
    starts = np.concatenate((starts[:, :6], starts[:, 6:] ** 2), 1)
    if process in KNOWN:
        kd, ks, alpha = initial_values(process, size=_OTHERS, rng=rng)
        others = np.concatenate((kd, ks, alpha[..., None]), -1).reshape(-1, 7)
        starts = np.concatenate((starts, others))
    frames, kept = len(change.mean), kept_by(process)
    left = 1 - (1 - kept) * change.gone[:, None]
    mean = np.concatenate((change.mean[:, :6], change.mean[:, 6:7] ** 2), 1)
    states = left[:, None] * starts + (mean - left * mean[0])[:, None]  # [T, n, 7]
    states = np.maximum(states, 0)
    states[..., 6] = states[..., 6].clip(ALPHA_MIN, 1)
    states[0] = starts
    rows = _OWN if len(starts) == _OWN**2 else 1
    states = states.reshape(frames, rows, -1, 7).astype(np.float32)
    size = states.shape[1:3]
    height = np.broadcast_to(change.mean[:, 7, None, None], states.shape[:3])
    return Sequence(
        states[..., :3],
        states[..., 3:6],
        states[..., 6],
        uniform_times(frames),
        np.zeros(size, np.float32),
        change.name,
        timing=_timing(change, process, seed),
        warnings=change.warnings,
        height=height.astype(np.float32) if change.has_height else None,
        residue=change.residue,
        strength=change.strength * np.float32(_weaker(change, kept)),
        share=change.share,
        sources=sources,
    )


def _weaker(change: Change, kept: float) -> float:
    """How much of the residue is to be added where a material keeps a share of its own
    differences: together they are to differ as much as the source's weathered texels.
    """
    own = np.square(kept) * change.starts.var(0).sum()
    whole = max(float(change.residue[..., :7].var((0, 1)).sum()), 1e-12)
    return float(np.sqrt(np.clip(1 - own / whole, 0.25, 1)))


def _timing(change: Change, process: str, seed: int) -> Timing:
    """The source's pattern and size, and the pace of the process: one scan cannot tell it."""
    pace = growth_of(process, None).pace
    onset = np.interp(np.linspace(0, 1, _SHARES), *np.transpose(pace))
    onset *= _SOONER
    onset -= _CLOSER * np.maximum(onset - _LATE, 0)
    rate = rate_map(process, (_PATTERN, _PATTERN), seed=seed)
    scale = float(np.clip(change.scale, 0.01, 1))
    waves = (
        ()
        if change.weathered is None
        else waves_of(change.weathered, scale=scale, process=process, seed=seed)
    )
    return Timing.of(onset, rate, scale=max(0.01, scale * change.extent), waves=waves)
