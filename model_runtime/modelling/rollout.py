"""From initial states to their histories, through whichever model of change is used."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass

from ..backend import Tensor, nn, torch
from ..brdf.fit import Fitter, at_a_time, fit_angles
from ..brdf.torrance_sparrow import evaluate
from ..channels import FURTHER, KD, KS, REFLECTANCES, WIDTH, optics
from ..contract import LSTM_LATENTS, Specular
from ..device import CPU
from ..errors import ModelFileError, shown
from ..representation.estimator import ParameterEstimator
from ..representation.latents import Latents, Representation
from ..states import clamped, with_reflectances
from ..temporal.ntm import NeuralTemporalModel
from .measured import follow_lobes

__all__ = ("Histories", "roll_out")

_BRIGHTEST = 3.0
_CHUNK = 256


@dataclass(frozen=True)
class Histories:
    """`states` [P, T, C] of P entries at T ages from 0 to 1, the fit's error, and the `device`
    that decoded and fitted. `further` [T, K, 8] are the lobes after the first, of a measured
    material that has such and went through latents.

    Where the states went through latents, states[:, 0] is the entry as the representation sees it,
    not the entry itself.
    """

    states: Tensor
    fit_error: float
    device: str = "cpu"
    further: Tensor | None = None


def roll_out(
    entries: Tensor,
    ntm: NeuralTemporalModel,
    rung: str,
    representation: Representation,
    *,
    samples: int | None = None,
    estimator: ParameterEstimator | None = None,
    specular: Specular = "rgb",
    measured: Latents | None = None,
    lobed: Tensor | None = None,
    device: torch.device = CPU,
    step: Callable[[float], None] = lambda fraction: None,
) -> Histories:
    """The histories of `entries` [P, C] under the model of change `rung` of `ntm`.

    Parameters are rolled out as they are. Latents are encoded from the entries' parameters, or from
    `samples` directions of them where that is given (`measured` are those of the only entry, where
    they are known), rolled out, decoded and fitted at every age, or told by an `estimator`: on
    `device`, for that is what takes time. Where that entry has several lobes, about `lobed` [1,
    C + 8 K], all of these are fitted. `step` hears which share is done.

    Raises ModelFileError where the NTM makes states that are not finite, or rolls out other latents
    than those of `representation`.
    """
    model, decoder = ntm.rung(rung), representation
    if rung != LSTM_LATENTS:
        device = CPU
    if device != CPU:
        model, decoder = deepcopy(ntm.latents).to(device), deepcopy(representation)
        assert isinstance(decoder, nn.Module)
        decoder.to(device)
        estimator = None if estimator is None else deepcopy(estimator).to(device)
    parts, errors, further = [], [0.0], None
    for start, stop in _chunks(len(entries)):
        chunk = entries[start:stop]
        if rung == LSTM_LATENTS:
            latents = (measured or _encode(chunk, representation, samples)).to(device)
            if ntm.latents.sizes != representation.latent_sizes:
                raise _unusable(ntm, "rolls out latents of another encoder")
            flat = model.rollout(latents.flat(), ntm.frames)
            if _leads_nowhere(flat, chunk):
                raise _unusable(ntm, "makes latents that are not finite")
            rolled = latents.unflat(flat)
            if lobed is not None:
                ages = flat.shape[1]
                states, error = follow_lobes(lobed, rolled, ages, decoder, specular)
                further = states[0, :, WIDTH:].unflatten(1, (-1, FURTHER))
                states = states[0, :, :WIDTH]
                errors.append(error)
            elif estimator is not None:
                states = estimator.parameters_of(rolled)
                states = _mono(states) if specular == "mono" else states
            else:
                states, error = _decode_and_fit(rolled, decoder, specular)
                errors.append(error)
            states = states.to(CPU).unflatten(0, flat.shape[:2])
        else:
            states = model.rollout(chunk, ntm.frames)
            if specular == "mono":
                states = _mono(states)
        if _leads_nowhere(states, chunk):
            raise _unusable(ntm, "makes values that are not finite")
        parts.append(_bounded(clamped(states), chunk))
        step(stop / len(entries))
    return Histories(torch.cat(parts), max(errors), str(device), further)


def _leads_nowhere(histories: Tensor, entries: Tensor) -> bool:
    """Whether any of `histories` [P, T, D] is not finite though its entry [P, C] is."""
    lost = ~histories.isfinite().flatten(1).all(1).to(CPU)
    return bool((lost & entries.isfinite().all(1)).any())


def _unusable(ntm: NeuralTemporalModel, what: str) -> ModelFileError:
    return ModelFileError(
        f"The model {shown(ntm.card.path.name)} {what}.", "Train it again, or choose a bundled one."
    )


def _bounded(states: Tensor, entries: Tensor) -> Tensor:
    """`states` [P, T, C] whose Kd + Ks is at most 3, or three times that of their entry [P, C] if
    that reflected more than all light; Kd and Ks of brighter ones are scaled down.

    The paper's S1 triples a material; whatever exceeds that is a model that has lost its way.
    """
    albedo = (states[..., KD] + states[..., KS]).amax(-1, keepdim=True)
    given = (entries[:, KD] + entries[:, KS]).amax(-1).clamp_min(1)
    share = (_BRIGHTEST * given[:, None, None] / albedo).clamp_max(1)
    return with_reflectances(states, states[..., REFLECTANCES] * share)


def _chunks(count: int) -> Iterator[tuple[int, int]]:
    for start in range(0, count, _CHUNK):
        yield start, min(start + _CHUNK, count)


def _encode(entries: Tensor, representation: Representation, samples: int | None) -> Latents:
    if samples is None:
        return representation.encode_parameters(entries)
    angles = representation.sample_angles(samples)
    return representation.encode(angles, evaluate(*optics(entries), angles))


def _decode_and_fit(
    latents: Latents, representation: Representation, specular: Specular
) -> tuple[Tensor, float]:
    """States [N, C] of N latents, and the largest relative error of their fits."""
    angles = fit_angles().to(latents.shared.device)
    fitter = Fitter(angles, specular=specular)
    each = (x.split(at_a_time(x.device)) for x in (latents.color, latents.shared))
    fits = [
        fitter.fit(representation.decode(Latents(*part), angles))
        for part in zip(*each, strict=True)
    ]
    error = max(float(fit.error.max()) for fit in fits)
    return torch.cat([fit.parameters() for fit in fits]), error


def _mono(states: Tensor) -> Tensor:
    """States [..., C] with one Ks for all colors."""
    kd, ks, _ = optics(states)
    ks = ks.mean(-1, keepdim=True).expand_as(ks)
    return with_reflectances(states, torch.cat((kd, ks), -1))
