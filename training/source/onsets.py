"""When, apart from what: the time at which each texel of a sequence starts to change.

The change of a texel is taken for a history that all share, begun at a time of its own,

    y(x, y, t) = g(a) y(x, y, 0) + o(a),   a = max(0, t - onset(x, y)),

with y the square roots of (kd, ks, alpha), as the eye sees them, and g, o the channelwise affine
model of change. The two are found in turns: the history from texels counted from their onsets, the
onset of each texel as the one that leaves the smallest squared error, over a fine grid of times.

A sequence that changes everywhere at once must not be given a timing that it has not. What is
found is kept only where it says what the first frame cannot. On texels and frames that were held
out, the error that the onsets leave is compared with the error of the best guess without them: that
of the affine model from time 0, and that of texels which began alike. Timing is kept where the
guess misses at least 2 % of the change, and the onsets leave at most three quarters of what it
misses.

A rate of each texel's own was tried as well. It explained little more of the real sequences (a
quarter of the error left by the onset) and made maps with patterns less like the truth's.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from model_runtime.states import perceptual
from model_runtime.temporal.models import Affine
from model_runtime.temporal.pace import Timing

from ..data.sequences import MixtureSequence, Sequence
from .histories import align

__all__ = ("correlation_length", "estimate_onset", "radial_covariance", "timed")

_TEXELS = 2048  # that the history is learned from, and as many to decide on
_ROUNDS = 6
_STEPS = 4  # onsets tried in each frame
_CHUNK = 8192
_BEGUN = 0.1  # of the change of the texels that change most: begun
_NEIGHBORS = 4
_MISSED = 0.02
_WORTHWHILE = 0.75
_FEWEST_FRAMES = 5


def timed(sequence: Sequence | MixtureSequence, *, seed: int = 0) -> Sequence | MixtureSequence:
    """`sequence` with its `onset` where it has a timing, and always with the statistics `timing`.

    Those that it brings are kept, an onset or statistics; what is missing is estimated. Mixtures
    are returned as they are.
    """
    if isinstance(sequence, MixtureSequence):
        return sequence
    onset = sequence.onset
    if onset is None:
        onset = estimate_onset(sequence, seed=seed)
    if sequence.timing is not None:
        timing = sequence.timing
    elif onset is None:
        timing = Timing.of(0.0)
    else:
        timing = Timing.of(onset, scale=correlation_length(onset))
    return replace(sequence, onset=onset, timing=timing)


def estimate_onset(sequence: Sequence, *, seed: int = 0) -> NDArray[np.float32] | None:
    """The time, 0 to 1, at which each texel starts to change, 1 for never: float32 [H, W]; None
    where the sequence shows no timing (see above), or is too short to show any: fewer than five
    frames or two texels.

    Values that must be clamped to be rendered are left out. `seed` draws the texels learned from.
    """
    frames, height, width = sequence.alpha.shape
    if frames < _FEWEST_FRAMES or height * width < 2:
        return None
    states = perceptual(torch.from_numpy(sequence.clamped().states()).flatten(0, 2))
    texels = _Texels(
        states.unflatten(0, (frames, height * width)),
        torch.from_numpy(~sequence.out_of_range()).flatten(1),
        sequence.times,
    )
    g = torch.Generator().manual_seed(seed)
    rows = torch.randperm(height * width, generator=g)[: 2 * _TEXELS]
    known, held = (texels.select(some) for some in rows.tensor_split(2))
    history = known.history(known.first_change())
    for _ in range(_ROUNDS):
        history = known.history(known.best_onset(history))
    if not _worthwhile(known, held, history):
        return None
    onset = [
        texels.select(some).best_onset(history)
        for some in torch.arange(height * width).split(_CHUNK)
    ]
    return torch.cat(onset).reshape(height, width).numpy()


class _Texels:
    """Histories of N texels: perceptual `states` [T, N, 7] at `times` [T], where `seen` [T, N]."""

    def __init__(self, states: Tensor, seen: Tensor, times: NDArray[np.float32]) -> None:
        self.states, self.seen, self.times = states, seen, times

    def select(self, rows: Tensor) -> _Texels:
        """Only the texels `rows`."""
        return _Texels(self.states[:, rows], self.seen[:, rows], self.times)

    def only(self, frames: slice) -> _Texels:
        """The same texels, seen only in some frames (and the first, which all start from)."""
        seen = torch.zeros_like(self.seen)
        seen[frames] = self.seen[frames]
        return _Texels(self.states, seen, self.times)

    def change(self) -> Tensor:
        """The squared change since the first frame, by frame [T, N]."""
        return (self.states - self.states[0]).square().sum(-1) * self.seen

    def first_change(self) -> Tensor:
        """The last time [N] at which hardly anything had changed: a first guess at the onset."""
        change = self.change()
        begun = change > _BEGUN * change.amax(0).quantile(0.9)
        frame = torch.where(begun.any(0), begun.float().argmax(0) - 1, len(begun) - 1)
        return torch.from_numpy(self.times)[frame.clamp_min(0)]

    def history(self, onset: Tensor) -> Affine:
        """What is shared, counted from `onset` [N]."""
        both = torch.cat((self.states, self.seen[..., None].float()), -1)
        histories, observed = align(both, self.times, onset.numpy())
        return Affine.fit(histories[..., :-1], observed & (histories[..., -1] == 1))

    def best_onset(self, history: Affine) -> Tensor:
        """The onset [N] of every texel with the smallest error."""
        tried = torch.linspace(0, 1, _STEPS * (len(self.times) - 1) + 1)
        return tried[self.errors(history, tried).argmin(1)]

    def errors(self, history: Affine, onset: Tensor) -> Tensor:
        """The summed squared error of every texel for each of K onsets: [N, K].

        |y - g y0 - o|^2 multiplied out, so that texels and onsets meet in products of matrices.
        """
        last = len(history.gain) - 1
        place = (torch.from_numpy(self.times)[:, None] - onset).clamp_min(0) * last  # [T, K]
        lower = place.floor().long().clamp(0, last - 1)
        share = (place - lower)[..., None]
        gain, offset = (
            torch.lerp(each[lower], each[lower + 1], share)
            for each in (history.gain, history.offset)
        )
        seen = self.seen.float().T
        total = torch.zeros(len(seen), len(onset))
        for channel in range(self.states.shape[-1]):
            y, g, o = self.states[..., channel].T, gain[..., channel], offset[..., channel]
            start, shown = self.states[0, :, channel, None], seen * y
            total += (shown * y).sum(1, keepdim=True) - 2 * (shown @ o) + seen @ (o * o)
            total += start * (start * (seen @ (g * g)) + 2 * (seen @ (g * o)) - 2 * (shown @ g))
        return total


def _worthwhile(known: _Texels, held: _Texels, history: Affine) -> bool:
    """Whether onsets tell what the first frame does not (see the module's text)."""
    some, rest = held.only(slice(0, None, 2)), held.only(slice(1, None, 2))
    onset = some.best_onset(history)
    error = _error_at(rest, history, onset)
    at_once = known.history(torch.zeros(known.states.shape[1]))
    guess = min(_error_at(rest, at_once, torch.zeros_like(onset)), _error_of_alike(known, rest))
    return guess > _MISSED * float(rest.change().sum()) and error < _WORTHWHILE * guess


def _error_at(texels: _Texels, history: Affine, onset: Tensor) -> float:
    """The summed squared error of texels, each at its own onset [N]."""
    different, which = onset.unique(return_inverse=True)
    return float(texels.errors(history, different).gather(1, which[:, None]).sum())


def _error_of_alike(known: _Texels, texels: _Texels) -> float:
    """The summed squared error of guessing each of `texels` as the mean of the known ones that
    began most like it, less what is due to that mean's being one of few.
    """
    count = min(_NEIGHBORS, known.states.shape[1])
    distance = torch.cdist(texels.states[0], known.states[0])
    nearest = distance.topk(count, largest=False).indices
    guess = known.states[:, nearest].mean(2)
    error = (guess - texels.states).square().sum(-1) * texels.seen
    return float(error.sum()) / (1 + 1 / count)


def radial_covariance(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Covariance of the texels of a map [H, W] by their distance in texels, over all directions: 0
    to a quarter of the shorter side, and at least 1.
    """
    height, width = values.shape
    longest = max(1, min(height, width) // 4)
    centerd = values.astype(np.float64) - values.mean()
    padded = (height + longest, width + longest)  # no wrapping within the distances looked at
    power = np.abs(np.fft.rfft2(centerd, padded)) ** 2
    pairs = np.abs(np.fft.rfft2(np.ones_like(centerd), padded)) ** 2
    total, count = np.fft.irfft2(power, padded), np.fft.irfft2(pairs, padded)
    down, across = (np.fft.fftfreq(side, 1 / side) for side in padded)
    distance = np.rint(np.hypot(down[:, None], across)).astype(np.int64)
    near = distance <= longest
    sums = np.bincount(distance[near], total[near], longest + 1)
    return sums / np.maximum(np.bincount(distance[near], count[near], longest + 1), 1)


def correlation_length(values: NDArray[np.floating]) -> float | None:
    """The distance, in units of the longer side, at which the texels of a map [H, W] are half as
    alike as one is to itself, or the longest looked at; None for a map that does not vary.
    """
    covariance = radial_covariance(values)
    if covariance[0] < 1e-9:
        return None
    alike = covariance / covariance[0]
    below = np.flatnonzero(alike < 0.5)
    if len(below) == 0:
        return float((len(alike) - 1) / max(values.shape))
    far = below[0]
    near = far - 1
    share = (alike[near] - 0.5) / (alike[near] - alike[far])
    return float((near + share) / max(values.shape))
