"""Textures from histories: every texel at its own age, anchored to what the artist gave."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..backend import Tensor, torch
from ..channels import ALPHA, ROUGHNESS_MIN, clip_planes, lobe_planes, turning
from ..maps import Halves, Pixels
from .palette import Palette
from .residues import HEIGHT_PLACE, Residues
from .rollout import Histories

__all__ = ("AgedBand", "AgedTexels", "anchored")

_BAND = 1 << 15
"""Texels worked on at a time where nobody asks for other bands: they stay in the cache."""

_FINE = 64  # steps from an age to the next at which residues are looked up


def anchored(histories: Tensor, initial: Tensor, gain: Tensor) -> Tensor:
    """`histories` [N, T, C] of texels that start as `initial` [N, C], not as states[:, 0].

        x(a) = P(a) + g(a) (x(0) - P(0)),

    where P is the history and g the `gain` [T, C]: the difference, which holds the representation's
    bias and, of a palette, its rounding, is carried along as far as the process lets differences
    live.
    """
    return histories + gain * (initial - histories[:, 0])[:, None]


@dataclass(frozen=True)
class AgedTexels:
    """n texels and all that is needed to tell any of them at any time.

    initial: [n, C] states at t = 0
    palette: which history a texel follows
    histories: of the palette's entries
    gain: [T, C] how much of a small initial difference is left at each age (the affine rung's)
    onset: [n] the time at which each texel's history starts, or None: all at 0
    rate: [n] how fast it then runs, at most 1, or None: 1
    residues: what it shows beyond its history, or None
    further: [T, K, 8] lobes after the first (`brdf.lobes`) of a measured material, which all texels
        have alike at each age; or None

    A texel of age a = rate max(0, time - onset) is x(a), its entry's history `anchored` to what it
    was, and its residues. Before its onset a texel is the input to the bit.
    """

    initial: Tensor
    palette: Palette
    histories: Histories
    gain: Tensor
    onset: Tensor | None
    rate: Tensor | None = None
    residues: Residues | None = None
    further: Tensor | None = None

    @cached_property
    def turns(self) -> list[bool]:
        """Of each lobe after the first whether its color ever turns with the view."""
        return [] if self.further is None else turning(self.further).any(0).tolist()

    def at(self, time: float) -> Tensor:
        """States [n, C] at `time` in 0..1."""
        states = self.initial.T.clone()
        for start in range(0, len(self.initial), _BAND):
            band = self.band(start, start + _BAND)
            started = band.started(time)
            if started:
                rows = torch.from_numpy(start + band.order[:started])
                states[:, rows] = torch.from_numpy(band.at(time))
        return states.T

    def averaged(self, ages: Tensor) -> AgedTexels:
        """Texels that show the mean over a source's timing instead of a time of their own.

        `ages` [T, T] weighs the ages at each time (`Timing.mean_of_ages`). Only for texels without
        onset and rate.
        """
        assert self.onset is None and self.rate is None
        states = torch.einsum("ta,pac->ptc", ages, self.histories.states)
        histories = replace(self.histories, states=states)
        residues = None if self.residues is None else self.residues.averaged(ages)
        further = self.further
        if further is not None:
            further = torch.einsum("ta,akc->tkc", ages, further)
        gain = ages @ self.gain
        return replace(self, histories=histories, gain=gain, residues=residues, further=further)

    def select(self, rows: Tensor) -> AgedTexels:
        """Only the texels `rows`."""
        return replace(
            self,
            initial=self.initial.T[:, rows].T,
            palette=replace(self.palette, index=self.palette.index[rows]),
            onset=None if self.onset is None else self.onset[rows],
            rate=None if self.rate is None else self.rate[rows],
            residues=None if self.residues is None else self.residues.select(rows),
        )

    def band(self, start: int, stop: int) -> AgedBand:
        """The texels from `start` to before `stop`, ready to be aged."""
        initial = self.initial[start:stop].numpy()
        onset = np.zeros(1, np.float32) if self.onset is None else self.onset[start:stop].numpy()
        rate = np.ones(1, np.float32) if self.rate is None else self.rate[start:stop].numpy()
        onset, rate = (np.broadcast_to(each, len(initial)) for each in (onset, rate))
        order = np.argsort(onset, kind="stable")
        entry = self.palette.index[start:stop].numpy()
        own = None
        if self.residues is not None and len(self.residues.shapes):
            own = self.residues.coefficients[:, start:stop].numpy().take(order, 1)
        return AgedBand(
            order,
            initial.T.take(order, 1),
            (entry * self._timelines.ages).astype(np.int32)[order],
            onset[order],
            rate[order],
            own,
            self._timelines,
        )

    @cached_property
    def _timelines(self) -> _Timelines:
        further = torch.zeros(len(self.gain), 0)
        if self.further is not None:
            further = torch.cat([*lobe_planes(self.further, self.turns).values()], 1)
        return _Timelines.of(self.histories.states, self.gain, self.residues, further)


@dataclass(frozen=True)
class _Timelines:
    """What the texels share, so that x(a) = own(a) + gain(a) x(0).

    own:  [C, P ages] P(a) - g(a) P(0), one entry after the other
    gain: [C, ages]
    ages: ages of an entry: the T modeled ones, and the last again to interpolate with
    shapes: [R, C + 1, fine ages] of residues, and height [fine ages]; None without any
    further: [L, ages] what maps show of lobes after the first, nothing without any
    """

    own: Pixels
    gain: Pixels
    ages: int
    shapes: Pixels | None
    height: Pixels | None
    further: Pixels

    @classmethod
    def of(
        cls, states: Tensor, gain: Tensor, residues: Residues | None, further: Tensor
    ) -> _Timelines:
        own = states - gain * states[:, :1]
        own, gain = (torch.cat((each, each[..., -1:, :]), -2) for each in (own, gain))
        columns = own.flatten(0, 1).T.contiguous(), gain.T.contiguous()
        shapes, height = None, None
        if residues is not None:
            ages = torch.linspace(0, 1, (len(gain) - 2) * _FINE + 1)
            shapes = residues.shapes_at(ages).transpose(1, 2).contiguous().numpy()
            height = residues.height_at(ages).numpy()
        lobes = torch.cat((further, further[-1:])).T.contiguous().numpy()
        return cls(columns[0].numpy(), columns[1].numpy(), len(gain), shapes, height, lobes)


@dataclass(frozen=True)
class AgedBand:
    """m texels in the order in which their histories start, so that those under way come first.

    order:   [m] their places in the band as it was cut
    initial: [C, m] at t = 0
    first:   [m] where in the timelines their entry's age 0 stands
    onset, rate: [m]
    residues: [R, m] their coefficients, halves; None without any
    """

    order: NDArray[np.intp]
    initial: Pixels
    first: NDArray[np.int32]
    onset: Pixels
    rate: Pixels
    residues: Halves | None
    timelines: _Timelines

    def started(self, time: float) -> int:
        """How many histories, the first ones of `order`, are under way at `time` in 0..1."""
        return int(np.searchsorted(self.onset, np.float32(time)))

    def at(self, time: float) -> Pixels:
        """States [C, k] at `time` of the k texels that have started."""
        place = self._place(time)
        k = len(place)
        floor = np.floor(place)
        share = place - floor
        age = floor.astype(np.intp)
        cell = self.first[:k] + age
        state = np.empty((len(self.initial), k), np.float32)
        for own, gain, initial, result in zip(
            self.timelines.own, self.timelines.gain, self.initial, state, strict=True
        ):
            np.multiply(_between(gain, age, share), initial[:k], out=result)
            result += _between(own, cell, share)
        clip_planes(state)
        if self.residues is not None:
            self._add_residues(state, place)
        return state

    def heights(self, time: float) -> Pixels:
        """Heights [k], likewise."""
        place = self._place(time)
        if self.timelines.height is None:
            return np.zeros(len(place), np.float32)
        age = _fine_age(place)
        heights = self.timelines.height.take(age, mode="clip")
        for own, shapes in self._own(len(age)):
            heights += shapes[HEIGHT_PLACE].take(age, mode="clip") * own
        return heights

    def further(self, time: float | None) -> Pixels:
        """What maps show of lobes after the first (`lobe_planes`), [L, k], likewise; where none has
        started yet, with None, of all texels.
        """
        if time is None:
            return np.repeat(self.timelines.further[:, :1], len(self.onset), 1)
        place = self._place(time)
        age = np.floor(place)
        lobes = np.empty((len(self.timelines.further), len(place)), np.float32)
        for line, result in zip(self.timelines.further, lobes, strict=True):
            result[:] = _between(line, age.astype(np.intp), place - age)
        return lobes

    def _place(self, time: float) -> Pixels:
        """How many modeled ages have passed, and which part of the next, [k]."""
        k = self.started(time)
        place = (np.float32(time) - self.onset[:k]) * np.float32(self.timelines.ages - 2)
        place *= self.rate[:k]
        return place

    def _add_residues(self, state: Pixels, place: Pixels) -> None:
        """Add them to `state` [C, k], in place; where they add to alpha they do to its root."""
        age = _fine_age(place)
        r = state[ALPHA.start]
        np.sqrt(r, out=r)
        for own, shapes in self._own(len(age)):
            for plane, shape in zip(state, shapes[:HEIGHT_PLACE], strict=True):
                if shape.any():
                    added = shape.take(age, mode="clip")
                    added *= own
                    plane += added
        np.square(r.clip(ROUGHNESS_MIN, 1), out=r)
        clip_planes(state)

    def _own(self, k: int) -> Iterator[tuple[Pixels, Pixels]]:
        """Each coefficient of the first k texels, [k], and what it is multiplied by, [C + 1, fine
        ages].
        """
        if self.residues is not None and self.timelines.shapes is not None:
            for own, shapes in zip(self.residues, self.timelines.shapes, strict=True):
                yield own[:k].astype(np.float32), shapes


def _fine_age(place: Pixels) -> NDArray[np.int32]:
    """Where in fine curves a place between modeled ages is."""
    return np.rint(place * np.float32(_FINE)).astype(np.int32)


def _between(line: Pixels, index: NDArray[np.intp], share: Pixels) -> Pixels:
    """line[index] and its successor, interpolated."""
    # Every index is in range: "clip" only spares numpy a second look at them.
    lower = line.take(index, mode="clip")
    value = line[1:].take(index, mode="clip")
    value -= lower
    value *= share
    value += lower
    return value
