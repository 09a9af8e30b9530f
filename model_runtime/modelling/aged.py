"""Texels modeled with as much effort as a quality allows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from ..backend import Tensor, torch
from ..contract import BALANCED, CONSTANT, DRAFT, EXACT, LSTM_LATENTS, Quality, Specular
from ..device import CPU
from ..images import Compression
from ..representation.estimator import ParameterEstimator
from ..representation.latents import PAPER_SAMPLES, Latents, Representation
from ..temporal.ntm import NeuralTemporalModel
from ..temporal.wear import Course
from .compose import AgedTexels
from .measured import MeasuredFit, anchored_lobes
from .palette import Palette, appearance_psnr, build_palette
from .residues import Residues
from .rollout import Histories, roll_out

__all__ = ("EFFORTS", "Change", "Effort", "model_texels")

_WORTHWHILE = 1.0  # dB that finer cells must gain to be made finer still
_CHECKED = 128  # texels on which a palette is compared with each modeled for itself
_CHECKED_AT = (0.03, 0.1, 0.3, 0.6, 1.0)  # of time: the first ages show in all frames, as fronts


@dataclass(frozen=True)
class Effort:
    """What a run spends; each field can be turned by itself.

    step: width of a palette's cells (perceptual coordinates); 0 models all that differ
    most: entries of a palette; its cells are widened until no more are left
    checked: whether texels modeled each for itself tell if the cells are fine enough
    samples: directions that the encoder is given; None takes its short cut from the parameters
    fit: whether decoded BRDFs are fitted; else an estimator tells what the fit finds
    interval: every so many frames each texel is aged; those between are interpolated
    compression: what is spent on making files small
    """

    step: float = 0.05
    most: int = 2048
    checked: bool = True
    samples: int | None = None
    fit: bool = False
    interval: int = 1
    compression: Compression = "zip"


EFFORTS: Mapping[Quality, Effort] = {
    DRAFT: Effort(step=0.12, most=256, checked=False, interval=3, compression="none"),
    BALANCED: Effort(),
    EXACT: Effort(step=0.0, most=0, checked=False, samples=PAPER_SAMPLES, fit=True),
}
"""What each quality (docs/design.md, command line) means."""


@dataclass(frozen=True)
class Change:
    """How texels change in a run: what those that are modeled share, whatever they start as.

    rung: of the ladder of `ntm`
    estimator: of the parameters of latents, where an effort has no fit; without one they are fitted
    specular: "mono" gives all colors one Ks
    measured: latents of the only texel, where a measured BRDF is behind it
    fit: how lobes show that BRDF
    course: that of texels which have begun already, where these go on instead of beginning
    device: where latents are decoded and fitted; should it fail, `warn` hears and the CPU does it
    warn: hears what the user should know, in sentences
    """

    ntm: NeuralTemporalModel
    rung: str
    representation: Representation
    estimator: ParameterEstimator | None = None
    specular: Specular = "rgb"
    measured: Latents | None = None
    fit: MeasuredFit | None = None
    course: Course | None = None
    device: torch.device = CPU
    warn: Callable[[str], None] = lambda message: None

    @property
    def lobed(self) -> Tensor | None:
        """The fit [1, C + 8 K] of the only texel, where it has several lobes."""
        return None if self.fit is None or self.fit.further is None else self.fit.lobed.lobed

    @property
    def gain(self) -> Tensor:
        """[T, C]: how much of a texel's own difference from its entry is left at each age."""
        gain = self.ntm.affine.gain
        return torch.ones_like(gain) if self.rung == CONSTANT else gain

    def aged(
        self,
        initial: Tensor,
        palette: Palette,
        histories: Histories,
        onset: Tensor | None = None,
        rate: Tensor | None = None,
        residues: Residues | None = None,
    ) -> AgedTexels:
        """Texels `initial` [n, C] that follow `histories`, those of the entries of `palette`.

        onset, rate: [n] when each starts and how fast it runs; without an onset all change as those
        of the source did on average.
        residues: what they show beyond their histories, where anything changes
        """
        residues = None if self.rung == CONSTANT else residues
        further = None if self.fit is None else self.fit.further
        if further is not None:
            further = anchored_lobes(further, histories.further, self.gain)
        texels = AgedTexels(initial, palette, histories, self.gain, onset, rate, residues, further)
        timing = self.ntm.timing
        if onset is not None or timing is None:
            return texels
        return texels.averaged(torch.from_numpy(timing.mean_of_ages(self.ntm.frames)))


def model_texels(
    initial: Tensor,
    change: Change,
    effort: Effort,
    *,
    onset: Tensor | None = None,
    rate: Tensor | None = None,
    residues: Residues | None = None,
    tolerance: float = math.inf,
    step: Callable[[float], None] = lambda fraction: None,
) -> AgedTexels:
    """Texels `initial` [n, C] with their histories under `change`.

    onset, rate, residues: as in `Change.aged`
    tolerance: dB that a checked palette is to reach against texels modeled and fitted each for
        itself. Where estimates miss it they are replaced by fits, and where the palette does its
        cells are halved as long as that helps; what is still missing is told to `change.warn`.
    step: hears which share of a palette is done
    """
    rollouts = _Rollouts(change, effort, step)
    if bool((initial == initial[0]).all()):
        palette = Palette(initial[:1].clone(), torch.zeros(len(initial), dtype=torch.long))
        found = _Modeled(palette, rollouts.fitted(palette.entries))
    else:
        palette = build_palette(initial, effort.step, most=effort.most)
        found = _Modeled(palette, rollouts.quick(palette.entries))
        if effort.checked:
            found = _refined(found, initial, rollouts, tolerance)
    return change.aged(initial, found.palette, found.histories, onset, rate, residues)


@dataclass(frozen=True)
class _Modeled:
    """A palette and the histories of its entries."""

    palette: Palette
    histories: Histories


class _Rollouts:
    """Rolls entries [P, C] out under a change, with an effort; a GPU that failed once is left
    alone.
    """

    def __init__(self, change: Change, effort: Effort, step: Callable[[float], None]) -> None:
        self.change, self.effort, self._step = change, effort, step
        self._device = change.device
        self.estimates = not effort.fit and change.estimator is not None

    def fitted(self, entries: Tensor) -> Histories:
        """With a fit where latents are decoded."""
        return self._with(entries, None)

    def quick(self, entries: Tensor) -> Histories:
        """With an estimate instead of the fit, where that is what the effort allows."""
        return self._with(entries, self.change.estimator if self.estimates else None)

    def _with(self, entries: Tensor, estimator: ParameterEstimator | None) -> Histories:
        try:
            return self._on(self._device, entries, estimator)
        except RuntimeError as error:  # torch's, out of memory among them
            if self._device == CPU:
                raise
            self.change.warn(f"The GPU failed ({str(error).splitlines()[0]}), so the CPU was used.")
            self._device = CPU
            return self._on(CPU, entries, estimator)

    def _on(
        self, device: torch.device, entries: Tensor, estimator: ParameterEstimator | None
    ) -> Histories:
        change = self.change
        found = roll_out(
            entries,
            change.ntm,
            change.rung,
            change.representation,
            samples=self.effort.samples,
            estimator=estimator,
            specular=change.specular,
            measured=change.measured,
            lobed=change.lobed,
            device=device,
            step=self._step,
        )
        if change.course is None:
            return found
        return replace(found, states=change.course.continued(entries, found.states))


@dataclass(frozen=True)
class _Sample:
    """Texels at random, modeled and fitted each for itself: what a palette is held against."""

    rows: Tensor
    own: Palette
    gain: Tensor
    truth: AgedTexels

    @classmethod
    def of(cls, initial: Tensor, rollouts: _Rollouts) -> _Sample:
        # At random: evenly spaced ones would fall in with the pattern of a texture.
        chance = torch.Generator().manual_seed(0)
        rows = torch.randint(len(initial), (min(_CHECKED, len(initial)),), generator=chance)
        own = Palette(initial[rows].contiguous(), torch.arange(len(rows)))
        gain = rollouts.change.gain
        truth = AgedTexels(own.entries, own, rollouts.fitted(own.entries), gain, None)
        return cls(rows, own, gain, truth)

    def reached_by(self, found: _Modeled) -> float:
        """PSNR in dB, at the worst age, where all texels follow `found`."""
        palette = found.palette
        return self._psnr(Palette(palette.entries, palette.index[self.rows]), found.histories)

    def reached_by_estimates(self, rollouts: _Rollouts) -> float:
        """Likewise where each texel is still modeled for itself, but not fitted."""
        return self._psnr(self.own, rollouts.quick(self.own.entries))

    def _psnr(self, palette: Palette, histories: Histories) -> float:
        estimate = AgedTexels(self.own.entries, palette, histories, self.gain, None)
        return min(appearance_psnr(self.truth.at(t), estimate.at(t)) for t in _CHECKED_AT)


def _refined(found: _Modeled, initial: Tensor, rollouts: _Rollouts, tolerance: float) -> _Modeled:
    """`found`, or what takes more effort, until texels `initial` reach `tolerance` dB
    (`model_texels`).
    """
    change, effort = rollouts.change, rollouts.effort
    sample = _Sample.of(initial, rollouts)
    modeled = rollouts.quick
    asked = change.rung == LSTM_LATENTS and rollouts.estimates
    if asked and sample.reached_by_estimates(rollouts) < tolerance:
        modeled = rollouts.fitted
        found = _Modeled(found.palette, modeled(found.palette.entries))
    psnr, gained, cells = sample.reached_by(found), math.inf, effort.step
    while psnr < tolerance and gained > _WORTHWHILE:
        cells /= 2
        finer = build_palette(initial, cells, most=effort.most)
        if len(finer.entries) <= len(found.palette.entries):
            break
        found = _Modeled(finer, modeled(finer.entries))
        before, psnr = psnr, sample.reached_by(found)
        gained = psnr - before
    if psnr < tolerance:
        change.warn(
            f"Modeling few materials reaches {psnr:.0f} of the {tolerance:g} dB asked for; choose "
            "quality exact to model every texel."
        )
    return found
