"""What an NTM learns from: the history of every texel of a sequence, counted from its own onset."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from model_runtime.brdf import torrance_sparrow
from model_runtime.brdf.fit import fit_angles, fit_torrance_sparrow
from model_runtime.channels import optics
from model_runtime.errors import InputError, shown
from model_runtime.representation.latents import Representation
from model_runtime.temporal.pace import Timing

from ..data.location import data_folder
from ..data.nbrdf import load
from ..data.sequences import MixtureSequence, Sequence

__all__ = ("MOST_TEXELS", "Mixture", "SourceHistories", "source_histories")

_SAMPLES = 256
"""Directions a BRDF is encoded from, where the representation leaves the choice."""

MOST_TEXELS = 8192
"""That a model learns from unless it is told otherwise."""

_CHUNK = 4096


@dataclass(frozen=True)
class Mixture:
    """What the states of measured mixtures only approximate: `weights` [N, T] of the second of two
    BRDFs, whose f [2, M, 3] at angles [M, 3] `pure` gives.
    """

    weights: Tensor
    pure: Callable[[Tensor], Tensor]

    def evaluate(self, angles: Tensor) -> Tensor:
        """The true f [N, T, M, 3] at `angles` [M, 3]."""
        first, second = self.pure(angles)
        return torch.lerp(first, second, self.weights[..., None, None])


@dataclass(frozen=True)
class SourceHistories:
    """N texels at T ages evenly spaced from 0 to 1.

    parameters: [N, T, C] states
    latents: [N, T, D] the same encoded, flat
    observed: [N, T] whether the sequence lasted long enough after the texel's onset to show the
        age, with values that can be rendered; the rest says nothing and is left out of every fit
    out_of_range: the share of the sequence's values that had to be clamped to be rendered
    mixture: the true values of measured mixtures, which `parameters` were fitted to; else None
    timing: when the sequence's texels start, as far as it is known
    warnings: what cannot be learned from the sequence for sure
    """

    parameters: Tensor
    latents: Tensor
    observed: Tensor
    out_of_range: float = 0.0
    mixture: Mixture | None = None
    timing: Timing | None = None
    warnings: tuple[str, ...] = ()

    def select(self, rows: Tensor) -> SourceHistories:
        """Only the texels `rows`."""
        mixture = self.mixture
        return replace(
            self,
            parameters=self.parameters[rows],
            latents=self.latents[rows],
            observed=self.observed[rows],
            mixture=mixture and replace(mixture, weights=mixture.weights[rows]),
        )

    def and_those(self, others: Iterable[SourceHistories]) -> SourceHistories:
        """These, and those of other sequences, none of them mixtures; the timing is of these."""
        parts = [self, *others]
        return replace(
            self,
            parameters=torch.cat([part.parameters for part in parts]),
            latents=torch.cat([part.latents for part in parts]),
            observed=torch.cat([part.observed for part in parts]),
            out_of_range=sum(part.out_of_range for part in parts) / len(parts),
            warnings=tuple(dict.fromkeys(said for part in parts for said in part.warnings)),
        )


def source_histories(
    sequence: Sequence | MixtureSequence,
    representation: Representation,
    *,
    texels: int = MOST_TEXELS,
    ages: int | None = None,
    seed: int = 0,
) -> SourceHistories:
    """The histories in `sequence`: at most `texels` of its texels, drawn by `seed`, at so many
    `ages`; as many as it has frames, unless it is told.
    """
    frames = len(sequence.times)
    if isinstance(sequence, MixtureSequence):
        weights = _sampled(sequence.weights.reshape(frames, -1, 1), texels, seed)
        return _mixture_histories(sequence, weights, representation)
    broken = sequence.out_of_range()
    marked = np.concatenate((sequence.clamped().states(), broken[..., None]), -1, dtype=np.float32)
    flat = marked.reshape(frames, -1, marked.shape[-1])
    onset = None if sequence.onset is None else sequence.onset.reshape(1, -1, 1)
    states = _sampled(flat, texels, seed)
    starts = np.zeros(states.shape[1]) if onset is None else _sampled(onset, texels, seed)[0, :, 0]
    histories, observed = align(torch.from_numpy(states), sequence.times, starts, ages)
    parameters, observed = histories[..., :-1].contiguous(), observed & (histories[..., -1] == 0)
    angles = representation.sample_angles(_SAMPLES)

    def values(states: Tensor) -> Tensor:
        return torrance_sparrow.evaluate(*optics(states), angles)

    latents = _encode(parameters, values, representation, angles)
    return SourceHistories(
        parameters,
        latents,
        observed,
        float(broken.mean()),
        timing=sequence.timing,
        warnings=sequence.warnings,
    )


def align(
    states: Tensor, times: np.ndarray, onset: np.ndarray, ages: int | None = None
) -> tuple[Tensor, Tensor]:
    """Histories [N, A, D] counted from `onset` [N], and which of their ages were observed [N, A].

    `states` [T, N, D] at `times` [T] are interpolated linearly at onset + age, for so many `ages`
    (T, unless it is told); ages beyond the last time repeat it and are not observed.
    """
    frames = len(times)
    age = torch.linspace(0, 1, ages or frames)
    wanted = torch.as_tensor(onset, dtype=torch.float32)[:, None] + age
    clock = torch.as_tensor(times, dtype=torch.float32)
    upper = torch.searchsorted(clock, wanted.contiguous()).clamp(1, frames - 1)
    span = (clock[upper] - clock[upper - 1]).clamp_min(1e-9)
    share = ((wanted - clock[upper - 1]) / span).clamp(0, 1)[..., None]
    rows = torch.arange(states.shape[1])[:, None]
    histories = torch.lerp(states[upper - 1, rows], states[upper, rows], share)
    histories[:, 0] = states[0]
    return histories, wanted <= clock[-1] + 1e-6


def _sampled(values: np.ndarray, texels: int, seed: int) -> np.ndarray:
    """At most `texels` columns of [T, n, D], the same ones for the same n and seed."""
    count = values.shape[1]
    if count <= texels:
        return values
    rows = np.sort(np.random.default_rng(seed).choice(count, texels, replace=False))
    return values[:, rows]


def _encode(states: Tensor, values, representation: Representation, angles: Tensor) -> Tensor:
    flat = states.reshape(-1, states.shape[-1])
    with torch.no_grad():
        parts = [
            representation.encode(angles, values(chunk)).flat() for chunk in flat.split(_CHUNK)
        ]
    return torch.cat(parts).unflatten(0, states.shape[:2])


def _mixture_histories(
    sequence: MixtureSequence, weights: np.ndarray, representation: Representation
) -> SourceHistories:
    known = load(data_folder(), "merl")
    for material in sequence.materials:
        if material not in known.names:
            raise InputError(
                f"There is no measured material called {shown(material)}.",
                f"Name two of MERL in mixture.json, such as {' and '.join(known.names[:2])}.",
            )
    measured = known.select(list(sequence.materials))

    def pure(angles: Tensor) -> Tensor:
        return measured.evaluate(torch.arange(2), angles)

    def mixed(angles: Tensor):
        first, second = pure(angles)
        return lambda w: torch.lerp(first, second, w[..., None])

    share = torch.from_numpy(weights).float().transpose(0, 1).contiguous()
    angles, wanted = representation.sample_angles(_SAMPLES, measured=True), fit_angles()
    latents = _encode(share, mixed(angles), representation, angles)
    values = mixed(wanted)
    fits = [
        fit_torrance_sparrow(values(chunk), wanted).parameters()
        for chunk in share.reshape(-1, 1).split(_CHUNK)
    ]
    parameters = torch.cat(fits).unflatten(0, share.shape[:2])
    observed = torch.ones(share.shape[:2], dtype=torch.bool)
    mixture = Mixture(share[..., 0], pure)
    return SourceHistories(parameters, latents, observed, mixture=mixture)
