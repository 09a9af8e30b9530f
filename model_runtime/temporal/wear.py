"""Wear that is there: texels that look as a model's materials do later on have begun already."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..states import clamped, perceptual
from .ntm import NeuralTemporalModel

__all__ = ("Course", "course_of")

_MATERIALS = 192  # of those a model was trained on, which tell the course that all take
_TOGETHER = 0.3  # spread of a course below which all materials look alike, of its whole way
_EARLIEST = 0.2  # age; before it hardly anything has happened yet
_NEAR = 0.3  # distance from it at which a texel is on it, likewise
_MOSTLY = 0.75  # share of worn texels beyond which the others only look a little different
_WIDER = 2.0
_CHUNK = 1 << 14


@dataclass(frozen=True)
class Course:
    """The way that all materials of a model take once they look alike: rust is rust, whatever
    rusted.

    ages: [A] from where they look alike, up to 1; none where they never do
    states: [A, 7] (kd, ks, alpha), the mean over materials
    near: distance (perceptual) up to which a texel is on it
    """

    ages: Tensor
    states: Tensor
    near: float

    def widened_to(self, parameters: Tensor) -> Course:
        """One that takes in all of a material [n, 7] that is worn nearly all over, its darkest and
        brightest spots too.
        """
        mostly = bool((self.age_of(parameters) > 0).float().mean() > _MOSTLY)
        return replace(self, near=_WIDER * self.near) if mostly else self

    def age_of(self, parameters: Tensor) -> Tensor:
        """[n]: the age at which texels `parameters` [n, 7] are on the course; 0 where they are
        nowhere near it.
        """
        found = torch.zeros(len(parameters))
        if len(self.ages) == 0:
            return found
        course = perceptual(self.states)
        for start in range(0, len(parameters), _CHUNK):
            away = torch.cdist(perceptual(parameters[start : start + _CHUNK]), course)
            distance, place = away.min(1)
            on = (distance < self.near) & (place > 0)
            found[start : start + _CHUNK] = self.ages[place] * on
        return found

    def onward(self, age: Tensor, frames: int) -> Tensor:
        """What texels that are at `age` [n] on the course still change: [n, frames, 7], from
        nothing to what it is at age 1, in as much time as it takes.
        """
        local = (age[:, None] + torch.linspace(0, 1, frames)).clamp_max(1)
        place = ((local - self.ages[0]) / (1 - self.ages[0])).clamp(0, 1) * (len(self.ages) - 1)
        lower = place.long().clamp_max(max(len(self.ages) - 2, 0))
        upper = (lower + 1).clamp_max(len(self.ages) - 1)
        state = torch.lerp(self.states[lower], self.states[upper], (place - lower)[..., None])
        return state - state[:, :1]

    def continued(self, entries: Tensor, states: Tensor) -> Tensor:
        """Histories `states` [P, T, 7] of `entries` [P, 7], but of those that are on the course
        already what is left of it: they keep what sets them apart, and never get younger.
        """
        age = self.age_of(entries)
        worn = age > 0
        if not worn.any():
            return states
        states = states.clone()
        onward = self.onward(age[worn], states.shape[1])
        states[worn] = clamped(entries[worn][:, None] + onward)
        return states


def course_of(ntm: NeuralTemporalModel) -> Course:
    """The course of the materials that `ntm` was trained on."""
    chance = torch.Generator().manual_seed(0)
    centers = ntm.domain.centres
    some = centers[torch.randperm(len(centers), generator=chance)[:_MATERIALS]].square()
    model = ntm.affine if ntm.chosen in ("constant", "affine") else ntm.parameters
    histories = model.rollout(some, ntm.frames)
    seen = perceptual(histories)
    mean = seen.mean(0)
    spread = (seen - mean).square().sum(-1).mean(0).sqrt()
    way = float((mean[-1] - mean[0]).norm())
    apart = (spread > _TOGETHER * way).nonzero()
    first = int(apart[-1, 0]) + 1 if len(apart) else 0
    first = max(first, math.ceil(_EARLIEST * (ntm.frames - 1)))
    ages = torch.linspace(0, 1, ntm.frames)[first:]
    return Course(ages, mean[first:].square(), _NEAR * way)
