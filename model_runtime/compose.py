"""Textures from histories: every texel at its own age, anchored to what the artist gave."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from .histories import Histories
from .plan import Palette, clamp_parameters

__all__ = ("AgedTexels",)

_CHUNK = 1 << 17


@dataclass(frozen=True)
class AgedTexels:
    """n texels and all that is needed to tell any of them at any time.

    initial: [n, 7] (kd, ks, alpha) at t = 0
    palette: which history a texel follows
    histories: of the palette's entries
    gain: [T, 7] how much of a small initial difference is left at each age (the affine rung's)
    onset: [n] the time at which each texel's history starts, or None: all at 0
    rate: [n] how fast it then runs, at most 1, or None: 1
    """

    initial: Tensor
    palette: Palette
    histories: Histories
    gain: Tensor
    onset: Tensor | None
    rate: Tensor | None = None

    def at(self, time: float) -> Tensor:
        """States [n, 7] at `time` in 0..1.

        A texel of age a = rate max(0, time - onset) is

            x(a) = P(a) + g(a) (x(0) - P(0)),

        where P is its entry's history and g the gain: the texel's own difference from its entry,
        which holds the palette's rounding and the representation's bias, is carried along as far as
        the process lets differences live. Before its onset a texel is the input to the bit.
        """
        states = self.initial.clone()
        if self.onset is None:
            rows = torch.arange(len(states) if time > 0 else 0)
        else:
            rows = (self.onset < time).nonzero()[:, 0]
        for chunk in rows.split(_CHUNK):
            states[chunk] = self._aged(chunk, time)
        return states

    def averaged(self, ages: Tensor) -> AgedTexels:
        """Texels that show the mean over a source's timing instead of a time of their own.

        `ages` [T, T] weighs the ages at each time (`Timing.mean_of_ages`). Only for texels without
        onset and rate.
        """
        assert self.onset is None and self.rate is None
        states = torch.einsum("ta,pac->ptc", ages, self.histories.states)
        histories = replace(self.histories, states=states)
        return replace(self, histories=histories, gain=ages @ self.gain)

    def select(self, rows: Tensor) -> AgedTexels:
        """Only the texels `rows`."""
        return replace(
            self,
            initial=self.initial[rows],
            palette=replace(self.palette, index=self.palette.index[rows]),
            onset=None if self.onset is None else self.onset[rows],
            rate=None if self.rate is None else self.rate[rows],
        )

    def _aged(self, rows: Tensor, time: float) -> Tensor:
        last = len(self.gain) - 1
        entry = self.palette.index[rows]
        table = self.histories.states
        difference = self.initial[rows] - table[entry, 0]
        if self.onset is None:
            place = torch.full((1,), time * last)
        else:
            place = (time - self.onset[rows]) * last
        if self.rate is not None:
            place = place * self.rate[rows]
        lower = place.floor().long().clamp(0, max(last - 1, 0))
        upper = (lower + 1).clamp(max=last)
        share = (place - lower)[:, None]
        state = torch.lerp(table[entry, lower], table[entry, upper], share)
        gain = torch.lerp(self.gain[lower], self.gain[upper], share)
        return clamp_parameters(torch.addcmul(state, gain, difference))
