"""Texels modelled with as much effort as a quality allows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from ..brdf.fit import USUAL, FitEffort
from ..brdf.measured import MeasuredBRDF
from ..contract import BALANCED, CONSTANT, DRAFT, EXACT, LSTM_LATENTS, Quality, Specular
from ..images import Compression
from ..representation.estimator import ParameterEstimator
from ..representation.latents import Representation
from ..temporal.ntm import NeuralTemporalModel
from .compose import AgedTexels
from .palette import Palette, appearance_psnr, build_palette
from .rollout import CPU, Histories, roll_out

__all__ = ("EFFORTS", "Effort", "model_texels")

_WORTHWHILE = 1.0  # dB that finer cells must gain to be made finer still
_CHECKED = 128  # texels on which a palette is compared with each modelled for itself
_CHECKED_AT = (0.03, 0.1, 0.3, 0.6, 1.0)  # of time: the first ages show in all frames, as fronts


@dataclass(frozen=True)
class Effort:
    """What a run spends; each field can be turned by itself.

    step: width of a palette's cells (perceptual coordinates); 0 models every texel for itself
    most: entries of a palette; its cells are widened until no more are left
    checked: whether texels modelled each for itself tell if the cells are fine enough
    samples: directions that the encoder is given; None takes its short cut from the parameters
    fit: what is spent on the fit of what was decoded; None lets an estimator tell what it finds
    interval: every so many frames each texel is aged; those between are interpolated
    compression: what is spent on making files small
    """

    step: float = 0.05
    most: int = 2048
    checked: bool = True
    samples: int | None = None
    fit: FitEffort | None = None
    interval: int = 1
    compression: Compression = "zip"


EFFORTS: Mapping[Quality, Effort] = {
    DRAFT: Effort(step=0.12, most=256, checked=False, interval=3, compression="none"),
    BALANCED: Effort(),
    EXACT: Effort(step=0.0, most=0, checked=False, samples=16_200, fit=USUAL),
}
"""What each quality (docs/design.md, command line) means."""


def model_texels(
    initial: Tensor,
    ntm: NeuralTemporalModel,
    rung: str,
    representation: Representation,
    effort: Effort,
    *,
    estimator: ParameterEstimator | None = None,
    onset: Tensor | None = None,
    rate: Tensor | None = None,
    tolerance: float = math.inf,
    specular: Specular = "rgb",
    measured: MeasuredBRDF | None = None,
    device: torch.device = CPU,
    step: Callable[[float], None] = lambda fraction: None,
    warn: Callable[[str], None] = lambda message: None,
) -> AgedTexels:
    """Texels `initial` [n, 7] (kd, ks, alpha) with histories under `rung` of `ntm`.

    estimator: of the parameters of latents, where `effort` has no fit; without one they are fitted.
    onset, rate: [n] when each history starts and how fast it runs; without an onset all texels
    change as those of the source did on average.
    tolerance: dB that a checked palette is to reach against texels modelled and fitted each for
    itself. Where estimates miss it they are replaced by fits, and where the palette does its cells
    are halved as long as that helps; what is still missing is told to `warn`.
    measured: the BRDF behind the only texel of `initial`, where there is one.
    device: where latents are decoded and fitted; should it fail, `warn` hears and the CPU does it.
    `step` hears which share of a palette is done.
    """
    gain = torch.ones_like(ntm.affine.gain) if rung == CONSTANT else ntm.affine.gain

    fitted = effort.fit or USUAL
    quick = fitted if effort.fit or estimator is None else estimator

    def modelled_on(
        device: torch.device, palette: Palette, fit: FitEffort | ParameterEstimator
    ) -> Histories:
        return roll_out(
            palette.entries,
            ntm,
            rung,
            representation,
            samples=effort.samples,
            fit=fit,
            specular=specular,
            measured=measured,
            device=device,
            step=step,
        )

    def modelled(palette: Palette, fit: FitEffort | ParameterEstimator) -> Histories:
        nonlocal device
        try:
            return modelled_on(device, palette, fit)
        except RuntimeError as error:  # torch's, out of memory among them
            if device == CPU:
                raise
            warn(f"The GPU failed ({str(error).splitlines()[0]}), so the CPU was used.")
            device = CPU
            return modelled_on(device, palette, fit)

    def aged(palette: Palette, histories: Histories) -> AgedTexels:
        texels = AgedTexels(initial, palette, histories, gain, onset, rate)
        if onset is not None or ntm.timing is None:
            return texels
        return texels.averaged(torch.from_numpy(ntm.timing.mean_of_ages(ntm.frames)))

    if bool((initial == initial[0]).all()):
        palette = Palette(initial[:1].clone(), torch.zeros(len(initial), dtype=torch.long))
        return aged(palette, modelled(palette, fitted))
    palette = build_palette(initial, effort.step, most=effort.most)
    histories = modelled(palette, quick)
    if not effort.checked:
        return aged(palette, histories)

    # At random: evenly spaced ones would fall in with the pattern of a texture.
    chance = torch.Generator().manual_seed(0)
    rows = torch.randint(len(initial), (min(_CHECKED, len(initial)),), generator=chance)
    own = Palette(initial[rows], torch.arange(len(rows)))
    truth = AgedTexels(own.entries, own, modelled(own, fitted), gain, None)

    def psnr_of(palette: Palette, histories: Histories) -> float:
        estimate = AgedTexels(own.entries, palette, histories, gain, None)
        return min(appearance_psnr(truth.at(t), estimate.at(t)) for t in _CHECKED_AT)

    def reached() -> float:
        return psnr_of(Palette(palette.entries, palette.index[rows]), histories)

    asked = rung == LSTM_LATENTS and isinstance(quick, ParameterEstimator)
    if asked and psnr_of(own, modelled(own, quick)) < tolerance:
        quick = fitted
        histories = modelled(palette, quick)
    psnr, gained, cells = reached(), math.inf, effort.step
    while psnr < tolerance and gained > _WORTHWHILE:
        cells /= 2
        finer = build_palette(initial, cells, most=effort.most)
        if len(finer.entries) <= len(palette.entries):
            break
        palette, histories = finer, modelled(finer, quick)
        before, psnr = psnr, reached()
        gained = psnr - before
    if psnr < tolerance:
        warn(
            f"Modeling few materials reaches {psnr:.0f} of the {tolerance:g} dB asked for; choose "
            "quality exact to model every texel."
        )
    return aged(palette, histories)
