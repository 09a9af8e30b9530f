"""One method in one trial: what comes out, and whether it can be used."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.linalg import LinAlgError
from numpy.polynomial import Chebyshev
from scipy.spatial import KDTree
from torch import Tensor, nn

from model_runtime.brdf.measured import MeasuredBRDF
from model_runtime.channels import ALPHA, ALPHA_MIN, REFLECTANCES, optics
from model_runtime.errors import InputError
from model_runtime.model_files.weights import save_model
from model_runtime.modelling.palette import build_palette
from model_runtime.states import clamped
from model_runtime.temporal.models import Affine
from model_runtime.temporal.ntm import NeuralTemporalModel

from ...data.sequences import Sequence
from ...metric.sphere import psnr
from ..bench.aging import texels_of
from ..bench.spheres import TexturedSphere
from ..synthesis.methods import Decoded, Method, Models, Rung, Transferred, method_for
from .measured import held_as_latents, held_by_the_product
from .product import age_trial
from .restart import killed_training
from .trials import GivenStage, Trial

__all__ = ("Outcome", "Trials")

_OUTSIDE = 0.01  # share of texels out of gamut that is a failure
_SLACK = 0.005  # how far out counts: nobody sees less
_BRIGHTEST = 3.0
_STEP = 0.05

Learned = TypeVar("Learned")


@dataclass(frozen=True)
class Outcome:
    """psnr: mean over the scored frames in dB, NaN where nothing or nothing finite came out.
    in_gamut: whether at most 1 % of what came out must be clamped, or is three times too bright.
    said: warnings and refusals of the product; empty for others.
    """

    psnr: float
    in_gamut: bool = True
    said: tuple[str, ...] = ()


@dataclass
class Trials:
    """Runs trials: methods are trained once for all that follow each other with one source."""

    models: Models
    sphere: TexturedSphere
    _source: str = ""
    _trained: dict[str, Method] = field(default_factory=dict)

    def run(self, trial: Trial, name: str) -> Outcome:
        """The method `name` trained on the trial's source and scored on its target."""
        case = trial.case
        if trial.measured is not None:
            return self._held(trial, trial.measured, name)
        stage = GivenStage(case, self.sphere, GivenStage.of(case, self.sphere).texels, trial.given)
        if trial.dtype is not None:
            stage = replace(stage, given=_stored(stage.initial, trial.dtype))
        try:
            models = self._models(trial)
            method = self._method(trial, name, models)
            if trial.dtype is not None:
                method = _stored(method, trial.dtype)
            if name != "ours":
                return _rival(trial, stage, method)
            assert isinstance(method, Rung)
            return _product(trial, stage, method, models.sources.folder)
        except (InputError, ValueError, LinAlgError):  # a baseline has no use for such data
            return Outcome(math.nan)

    def _held(self, trial: Trial, measured: MeasuredBRDF, name: str) -> Outcome:
        sphere = self.sphere.sphere
        if name == "ours":
            method_for(name, trial.case, self.models)  # trained, whose file the product takes
            path = self.models.sources.folder / f"ntm_{trial.case.source_key}.safetensors"
            psnr, said = held_by_the_product(measured, path, sphere)
            return Outcome(psnr, said=said)
        ours = name not in self.models.encoders
        representation, _ = self.models.encoders["ours" if ours else name]
        return Outcome(held_as_latents(measured, representation, sphere, refined=ours))

    def _method(self, trial: Trial, name: str, models: Models) -> Method:
        if self._source != trial.case.source_key:
            self._source, self._trained = trial.case.source_key, {}
        if trial.killed is not None:
            return method_for(name, trial.case, models)
        if name not in self._trained:
            self._trained[name] = method_for(name, trial.case, models)
        return self._trained[name]

    def _models(self, trial: Trial) -> Models:
        sources, source = self.models.sources, trial.case.source
        if trial.killed is None:
            return self.models
        assert isinstance(source, Sequence)
        killed = killed_training(sources, trial.case.source_key, source, trial.killed)
        return replace(self.models, sources=killed)


def _product(trial: Trial, stage: GivenStage, method: Rung, folder: Path) -> Outcome:
    path = folder / f"ntm_{trial.case.source_key}.safetensors"
    if trial.dtype is not None:
        path = folder / "stored.safetensors"
        save_model(path, method.ntm.tensors(), method.ntm.card.details, kind="ntm")
    aged = age_trial(trial, stage.initial, path)
    if aged.states is None:
        return Outcome(math.nan, said=aged.said)
    return replace(_scored_states(trial, stage, aged.states, None), said=aged.said)


def _rival(trial: Trial, stage: GivenStage, method: Method) -> Outcome:
    if isinstance(method, Transferred):
        sequence = method.model.synthesize(stage.initial, trial.case.target.times)
        return _scored_states(trial, stage, texels_of(sequence).flatten(1, 2)[trial.frames], None)
    pixels = _few(stage) if method.dear(stage) else torch.arange(len(stage.texels))
    if isinstance(method, Decoded):
        steps = None if trial.span > 1 else len(trial.case.source.times)
        method = replace(method, samples=trial.samples or method.samples, steps=steps)
        return _scored(trial, stage, method.estimate(stage, trial.frames, pixels), pixels)
    assert isinstance(method, Rung)
    method = replace(method, samples=trial.samples)
    if trial.span > 1:
        method = replace(method, ntm=_lengthened(method.ntm, stage.frames))
    start, rung = stage.start, method.rung(stage)
    palette = None if trial.palette is None else build_palette(start, _STEP, most=trial.palette)
    if palette is None:
        texels, aged = stage.texels[pixels], method.aged(start[stage.texels[pixels]], rung)
    else:
        texels, aged = torch.arange(len(start)), method.aged(start, rung, palette=palette)
    states = torch.full((len(trial.frames), *start.shape), torch.nan)
    for row, frame in enumerate(trial.frames):
        states[row, texels] = aged.at(frame / (stage.frames - 1))
    return _scored_states(trial, stage, states, pixels)


def _few(stage: GivenStage) -> Tensor:
    """The pixels on which a dear method is scored: where texels are broken, one such among them."""
    shown = stage.start[stage.texels]
    broken = (~shown.isfinite() | (shown < 0)).any(-1).nonzero()[:1, 0]
    return torch.cat((stage.sphere.few, broken)).unique()


def _lengthened(ntm: NeuralTemporalModel, frames: int) -> NeuralTemporalModel:
    """An NTM that is rolled out further: LSTMs go on, the affine model stays as it was last."""

    def held(values: Tensor) -> Tensor:
        return torch.cat((values, values[-1:].expand(frames - len(values), -1)))

    affine = Affine(held(ntm.affine.gain), held(ntm.affine.offset))
    return replace(ntm, affine=affine, card=replace(ntm.card, frames=frames))


def _scored_states(
    trial: Trial, stage: GivenStage, states: Tensor, pixels: Tensor | None
) -> Outcome:
    """Of states [t, H W, C] in the scored frames, looked at in `pixels` (None: all)."""
    pixels = torch.arange(len(stage.texels)) if pixels is None else pixels
    shown = states[:, stage.texels[pixels]]
    outcome = _scored(trial, stage, stage.sphere.render(clamped(shown), pixels), pixels)
    if not bool(shown[:, _counted(trial, stage, pixels)].isfinite().all()):
        return Outcome(math.nan)
    target = trial.case.target
    assert isinstance(target, Sequence)
    true = texels_of(target).flatten(1, 2)[trial.frames][:, stage.texels[pixels]]
    out = _out_of_gamut(shown, true, stage.start[stage.texels[pixels]])
    share = float(out[:, _counted(trial, stage, pixels)].float().mean(1).max())
    return replace(outcome, in_gamut=share <= _OUTSIDE)


def _out_of_gamut(states: Tensor, true: Tensor, given: Tensor) -> Tensor:
    """Which of `states` [t, p, C] cannot be rendered as they are, though the `true` ones can, or
    reflect three times as much as those, as `given` [p, C], and as all light.
    """

    def unfit(some: Tensor) -> Tensor:
        dark = (some[..., REFLECTANCES] < -_SLACK).any(-1)
        alpha = some[..., ALPHA.start]
        return dark | (alpha < ALPHA_MIN - _SLACK) | (alpha > 1 + _SLACK)

    def reflected(some: Tensor) -> Tensor:
        kd, ks, _ = optics(some)
        return (kd + ks).amax(-1)

    usual = torch.maximum(reflected(true), reflected(given)).clamp_min(1)
    return (unfit(states) & ~unfit(true)) | (reflected(states) > _BRIGHTEST * usual)


def _scored(trial: Trial, stage: GivenStage, radiance: Tensor, pixels: Tensor) -> Outcome:
    """Of radiance [t, E, p, 3] at `pixels` [p] in the scored frames."""
    counted = _counted(trial, stage, pixels)
    truth = stage.truth[trial.frames][:, :, pixels][:, :, counted]
    shown = radiance[:, :, counted]
    if not bool(shown.isfinite().all()):
        return Outcome(math.nan)
    return Outcome(float(psnr(truth, shown).mean()))


def _counted(trial: Trial, stage: GivenStage, pixels: Tensor) -> Tensor:
    """Places among `pixels` whose texels count."""
    if trial.unscored is None:
        return torch.arange(len(pixels))
    unscored = torch.from_numpy(trial.unscored).flatten()[stage.texels[pixels]]
    return (~unscored).nonzero()[:, 0]


def _stored(value: Learned, dtype: torch.dtype) -> Learned:
    """A copy of anything given or learned, all of its numbers rounded to `dtype`."""
    return _rounded(copy.deepcopy(value), dtype)


def _rounded(value: Any, dtype: torch.dtype) -> Any:
    if isinstance(value, Tensor):
        return value.to(dtype).to(value.dtype) if value.is_floating_point() else value
    if isinstance(value, np.ndarray):
        return _rounded(torch.from_numpy(value), dtype).numpy()
    if isinstance(value, nn.Module):
        for tensor in (*value.parameters(), *value.buffers()):
            tensor.data = _rounded(tensor.data, dtype)
        return value
    if isinstance(value, Chebyshev):
        return Chebyshev(_rounded(value.coef, dtype), value.domain)
    if isinstance(value, Affine):
        return Affine(_rounded(value.gain, dtype), _rounded(value.offset, dtype))
    if isinstance(value, tuple):
        return tuple(_rounded(each, dtype) for each in value)
    if isinstance(value, (str, KDTree)) or not hasattr(value, "__dataclass_fields__"):
        return value
    changed = {f.name: _rounded(getattr(value, f.name), dtype) for f in fields(value)}
    return replace(value, **changed)
