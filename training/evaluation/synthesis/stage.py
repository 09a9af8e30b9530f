"""A case on its sphere: what the truth shows, what methods are given of it, and how far off they
are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from model_runtime.brdf import torrance_sparrow
from model_runtime.brdf.fit import fit_angles, fit_torrance_sparrow
from model_runtime.channels import optics
from model_runtime.maps import TorranceSparrowMaps
from model_runtime.states import clamped, rows_of

from ...data.location import data_folder
from ...data.nbrdf import load
from ...data.sequences import MixtureSequence, Sequence
from ...metric.sphere import psnr
from ..bench.aging import texels_of
from ..bench.spheres import TexturedSphere
from .cases import Case

__all__ = ("Stage", "as_parameters", "thinned")

_MIXTURES = 256


@dataclass(frozen=True)
class Stage:
    """`case` on a sphere whose pixels [P] show the target's `texels` [P]."""

    case: Case
    sphere: TexturedSphere
    texels: Tensor

    @classmethod
    def of(cls, case: Case, sphere: TexturedSphere) -> Stage:
        """The target wrapped over the sphere."""
        target = case.target
        maps = target.weights if isinstance(target, MixtureSequence) else target.alpha
        return cls(case, sphere, sphere.texels(*maps.shape[1:]))

    @property
    def frames(self) -> int:
        """How many there are, the given one included."""
        return len(self.case.target.times)

    @property
    def measured(self) -> bool:
        """Whether no parameters hold the truth."""
        return isinstance(self.case.target, MixtureSequence)

    @cached_property
    def initial(self) -> TorranceSparrowMaps:
        """The first frame: what methods are given."""
        first = as_parameters(self.case.target).clamped()
        return TorranceSparrowMaps(first.kd[0], first.ks[0], first.alpha[0])

    @cached_property
    def start(self) -> Tensor:
        """The first frame's states [H W, C]."""
        return rows_of(self.initial)

    @cached_property
    def _shown(self) -> Tensor:
        """The truth in pixels: clamped states [T, P, C], or weights [T, P] of a mixture."""
        target = self.case.target
        if isinstance(target, MixtureSequence):
            return torch.from_numpy(target.weights).flatten(1)[:, self.texels]
        return clamped(texels_of(target).flatten(1, 2)[:, self.texels])

    @cached_property
    def truth(self) -> Tensor:
        """Radiance [T, E, P, 3]."""
        target = self.case.target
        if not isinstance(target, MixtureSequence):
            return self.sphere.render(self._shown)
        pure = self.sphere.sphere.render(lambda a: _ends(target).evaluate(torch.arange(2), a))
        return torch.lerp(pure[:1], pure[1:], self._shown[:, None, :, None])

    def values(self, frame: int, pixels: Tensor, angles: Tensor) -> Tensor:
        """The true f [p, M, 3] of the texels at `pixels` [p] in a frame."""
        shown, target = self._shown[frame, pixels], self.case.target
        if isinstance(target, MixtureSequence):
            pure = _ends(target).evaluate(torch.arange(2), angles)
            return torch.lerp(pure[:1], pure[1:], shown[:, None, None])
        return torrance_sparrow.evaluate(*optics(shown), angles)

    def score(self, radiance: Tensor, frames: list[int], pixels: Tensor) -> list[float]:
        """PSNR in dB of `radiance` [t, E, p, 3] in each frame, averaged over the maps."""
        return psnr(self.truth[frames][:, :, pixels], radiance).mean(1).tolist()


def _ends(mixture: MixtureSequence):
    return load(data_folder(), "merl").select(list(mixture.materials))


def as_parameters(sequence: Sequence | MixtureSequence) -> Sequence:
    """A sequence as methods that know only Torrance-Sparrow see it; of mixtures the best fit, each
    weight rounded to a 255th.
    """
    if isinstance(sequence, Sequence):
        return sequence
    pure = _ends(sequence).evaluate(torch.arange(2), fit_angles())
    share = torch.linspace(0, 1, _MIXTURES)[:, None, None]
    fits = fit_torrance_sparrow(torch.lerp(pure[:1], pure[1:], share)).parameters().numpy()
    states = fits[np.rint(sequence.weights * (_MIXTURES - 1)).astype(np.int64)]
    return Sequence.of(states, sequence.times, sequence.name)


def thinned(
    sequence: Sequence | MixtureSequence, count: int, *, seed: int = 0
) -> Sequence | MixtureSequence:
    """At most `count` texels of a sequence in a row, for methods that look at single texels."""
    mixed = isinstance(sequence, MixtureSequence)
    total = (sequence.weights if mixed else sequence.alpha)[0].size
    rows = np.random.default_rng(seed).permutation(total)[:count]

    def some(maps: np.ndarray) -> np.ndarray:
        return maps.reshape(len(maps), total, *maps.shape[3:])[:, None, rows]

    if isinstance(sequence, MixtureSequence):
        return MixtureSequence(
            sequence.materials, some(sequence.weights), sequence.times, sequence.name
        )
    onset = None if sequence.onset is None else some(sequence.onset[None])[0]
    kd, ks, alpha = (some(maps) for maps in (sequence.kd, sequence.ks, sequence.alpha))
    return replace(sequence, kd=kd, ks=ks, alpha=alpha, onset=onset)
