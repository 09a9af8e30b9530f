"""Wear that is there: texels that look as a model's materials do later on have begun already."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..backend import Tensor, torch
from ..contract import AFFINE, CONSTANT
from ..states import clamped, perceptual
from .ntm import NeuralTemporalModel

__all__ = ("Course", "course_of", "stains_of")

_MATERIALS = 192  # of those a model was trained on, which tell the course that all take
_TOGETHER = 0.3  # spread of a course below which all materials look alike, of its whole way
_NEAR = 0.3  # distance from it at which a texel is on it, likewise
_EARLIEST = 0.2  # age; before it hardly anything has happened yet,
_MOST = 0.8  # unless so much of the way is gone
_FADING = 0.5  # share of that distance over which texels are ever less on it
_BEGINNING = 0.1  # age over which, after the earliest, they are ever more on it, if all is left
_MOSTLY = 0.75  # share of worn texels beyond which the others only look a little different
_WIDER = 2.0
_STAINED, _STRENGTHS = 0.85, 18  # of the way that materials go: how far the strongest stain is
_CHUNK = 1 << 14
_EXACT = "donot_use_mm_for_euclid_dist"


@dataclass(frozen=True)
class Course:
    """The way that all materials of a model take once they look alike: rust is rust, whatever
    rusted.

    ages: [A] from where they look alike, up to 1; none where they never do
    states: [A, C], the mean over materials
    near: distance (perceptual) up to which a texel is on it
    beginning: age over which texels are ever more on it
    """

    ages: Tensor
    states: Tensor
    near: float
    beginning: float

    def widened_to(self, parameters: Tensor) -> Course:
        """One that takes in all of a material [n, C] that is worn nearly all over, its darkest and
        brightest spots too.
        """
        mostly = bool((self.age_of(parameters) > 0).float().mean() > _MOSTLY)
        return replace(self, near=_WIDER * self.near) if mostly else self

    def age_of(self, parameters: Tensor) -> Tensor:
        """[n]: the age at which texels `parameters` [n, C] are on the course; 0 where they are
        nowhere near it.
        """
        age, share = self._place_of(parameters)
        return age * (share > 0.5)

    def share_of(self, parameters: Tensor) -> Tensor:
        """[n]: how far, 0 to 1, texels `parameters` [n, C] are on the course."""
        return self._place_of(parameters)[1]

    def _place_of(self, parameters: Tensor) -> tuple[Tensor, Tensor]:
        """[n] each: the age of what is nearest on the course, and how far, 0 to 1, they are on it:
        by degrees, so that texels which nearly look alike age alike.
        """
        age, share = torch.zeros(2, len(parameters))
        if len(self.ages) == 0:
            return age, share
        course = perceptual(self.states)
        for start in range(0, len(parameters), _CHUNK):
            part = slice(start, start + _CHUNK)
            # exact: what has weathered for long changes by less than products of matrices tell
            away = torch.cdist(perceptual(parameters[part]), course, compute_mode=_EXACT)
            distance, place = away.min(1)
            age[part] = self.ages[place]
            near = ((1 - distance / self.near) / _FADING + 0.5).clamp(0, 1)
            share[part] = near * ((age[part] - self.ages[0]) / self.beginning).clamp(0, 1)
        return age, share

    def sound(self, parameters: Tensor) -> Tensor:
        """Those of `parameters` [n, C] that have not begun; all, where all have."""
        sound = self.age_of(parameters) == 0
        return parameters[sound] if sound.any() else parameters

    def onward(self, age: Tensor, frames: int) -> Tensor:
        """What texels that are at `age` [n] on the course still change: [n, frames, C], from
        nothing to what it is at age 1, in as much time as it takes.
        """
        local = (age[:, None] + torch.linspace(0, 1, frames)).clamp_max(1)
        place = ((local - self.ages[0]) / (1 - self.ages[0])).clamp(0, 1) * (len(self.ages) - 1)
        lower = place.long().clamp_max(max(len(self.ages) - 2, 0))
        upper = (lower + 1).clamp_max(len(self.ages) - 1)
        state = torch.lerp(self.states[lower], self.states[upper], (place - lower)[..., None])
        return state - state[:, :1]

    def continued(self, entries: Tensor, states: Tensor) -> Tensor:
        """Histories `states` [P, T, C] of `entries` [P, C], but of those that are on the course
        already what is left of it: they keep what sets them apart, and never get younger.
        """
        age, share = self._place_of(entries)
        worn = share > 0
        if not worn.any():
            return states
        states = states.clone()
        onward = self.onward(age[worn], states.shape[1])
        gone_on = clamped(entries[worn][:, None] + onward)
        states[worn] = torch.lerp(states[worn], gone_on, share[worn][:, None, None])
        return states


def course_of(ntm: NeuralTemporalModel) -> Course:
    """The course of the materials that `ntm` was trained on."""
    seen = _typical(ntm)
    mean = seen.mean(0)
    spread = (seen - mean).square().sum(-1).mean(0).sqrt()
    way = float((mean[-1] - mean[0]).norm())
    apart = (spread > _TOGETHER * way).nonzero()
    first = int(apart[-1, 0]) + 1 if len(apart) else 0
    gone = int(((mean - mean[-1]).norm(dim=-1) < (1 - _MOST) * way).int().argmax())
    first = max(first, min(gone, math.ceil(_EARLIEST * (ntm.frames - 1))))
    ages = torch.linspace(0, 1, ntm.frames)[first:]
    # The more is gone at first, the sooner that is told from what has not begun; not at once, or
    # texels that nearly look alike would not age alike.
    left = float((mean[first:] - mean[-1]).norm(dim=-1).max()) / way if len(ages) else 1.0
    return Course(ages, mean[first:].square(), _NEAR * way, _BEGINNING * math.sqrt(min(left, 1.0)))


def stains_of(ntm: NeuralTemporalModel) -> tuple[float, ...]:
    """Ages, from 0, at which those materials have gone ever more of their way on average, in equal
    steps up to `_STAINED`: as whom stains of rising strength look.
    """
    seen = _typical(ntm)
    gone = (seen - seen[:, :1]).norm(dim=-1).mean(0).cummax(0).values.numpy()
    ages = np.linspace(0, 1, len(gone))
    # A little rises with age, so that where nothing changes any more there is one answer.
    shares = gone / max(float(gone[-1]), 1e-6) + 1e-3 * ages
    return tuple(np.interp(np.linspace(0, _STAINED, _STRENGTHS), shares, ages).round(4).tolist())


def _typical(ntm: NeuralTemporalModel) -> Tensor:
    """Histories [P, T, C], perceptual, of some of the materials that `ntm` was trained on."""
    chance = torch.Generator().manual_seed(0)
    centers = ntm.domain.centers
    some = centers[torch.randperm(len(centers), generator=chance)[:_MATERIALS]].square()
    model = ntm.affine if ntm.chosen in (CONSTANT, AFFINE) else ntm.parameters
    histories = model.rollout(some, ntm.frames)
    return perceptual(histories)
