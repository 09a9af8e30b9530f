"""Which rung of the ladder suffices: what is held out, how a rung is scored on it, which is chosen.

A rung is cross-validated in three ways: on texels it did not see, and on the texels `above` and
`below` the range of initial values it was fitted to. The first tells how well it describes one
material, the others how well it carries over to a different one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from model_runtime.contract import LADDER, LSTM_LATENTS
from model_runtime.modelling.compose import anchored
from model_runtime.modelling.palette import viewed, viewed_psnr, viewing_angles
from model_runtime.modelling.rollout import roll_out
from model_runtime.representation.latents import Latents, Representation
from model_runtime.states import perceptual
from model_runtime.temporal.ntm import NeuralTemporalModel

from .source.histories import SourceHistories

__all__ = (
    "Split",
    "choose",
    "held_out_ranges",
    "held_out_texels",
    "score",
    "suffices",
    "widest_channel",
)

_HELD_OUT = 0.1
_RANGE = 0.7  # share of the texels on one side of a range, the others lie beyond it
_VALIDATION_TEXELS = 256
_BEST = 100.0  # dB, as high as `viewed_psnr` goes


@dataclass(frozen=True)
class Split:
    """Histories that a rung is fitted to, and at most 256 others that it is then scored on. Of a
    source with a single texel both are that texel.
    """

    train: SourceHistories
    test: SourceHistories


def held_out_texels(source: SourceHistories, seed: int) -> Split:
    """A tenth of the texels of `source`, drawn by `seed`, is held out."""
    g = torch.Generator().manual_seed(seed)
    order = torch.randperm(len(source.parameters), generator=g)
    held = max(1, int(len(order) * _HELD_OUT))
    return _split(source, order[held:], order[:held][:_VALIDATION_TEXELS])


def held_out_ranges(source: SourceHistories, channel: int) -> dict[str, Split]:
    """`above`: trained below the 70th percentile of `channel` at age 0, tested above it. `below`:
    trained above the 30th, tested below.

    Percentiles are ranks, so that no side is empty however many texels are alike.
    """
    order = source.parameters[:, 0, channel].argsort(stable=True)
    count = max(1, round(len(order) * (1 - _RANGE)))
    low, high = order[:count], order[len(order) - count :]
    return {
        "above": _split(source, order[: len(order) - count], _spread(high)),
        "below": _split(source, order[count:], _spread(low)),
    }


def _spread(rows: Tensor) -> Tensor:
    """At most 256 of `rows`, evenly."""
    count = min(len(rows), _VALIDATION_TEXELS)
    return rows[torch.linspace(0, len(rows) - 1, count).round().long()]


def _split(source: SourceHistories, train: Tensor, test: Tensor) -> Split:
    return Split(source.select(train if len(train) else test), source.select(test))


def widest_channel(source: SourceHistories) -> int:
    """The channel of a state, counted from 0, whose initial values differ most to the eye.

    Other materials will differ from the source along what its own texels differ in, and where that
    is widest a held-out range is farthest from what is left: the hardest extrapolation that the
    source can be asked for. (A channel in which all texels are alike would hold nothing out.)
    """
    return int(perceptual(source.parameters[:, 0]).std(0, correction=0).argmax())


def score(
    rung: str, ntm: NeuralTemporalModel, test: SourceHistories, representation: Representation
) -> float:
    """Appearance PSNR in dB of histories that `ntm` did not see: the mean over the ages at which
    any was observed, as reports average over frames. (Of all ages at once the worst would decide.)

    Parameters, and latents once fitted, are anchored as aging anchors them and compared with the
    true ones. Where the truth is measured, no parameters hold it: BRDFs are compared, those of
    the rung on latents as decoded. Where no age was observed nothing is missed: 100 dB.
    """
    if test.mixture is not None and rung == LSTM_LATENTS:
        with torch.no_grad():
            flat = ntm.latents.rollout(test.latents[:, 0], ntm.frames).flatten(0, 1)
            estimate = representation.decode(_unflat(flat, representation), viewing_angles())
    else:
        estimate = viewed(_anchored(rung, ntm, test, representation))
    if test.mixture is not None:
        truth = test.mixture.evaluate(viewing_angles())
    else:
        truth = viewed(test.parameters).unflatten(0, test.observed.shape)
    estimate = estimate.unflatten(0, test.observed.shape)
    ages = [
        viewed_psnr(truth[seen, age], estimate[seen, age])
        for age, seen in enumerate(test.observed.T)
        if age > 0 and seen.any()
    ]
    return sum(ages) / len(ages) if ages else _BEST


def _anchored(
    rung: str, ntm: NeuralTemporalModel, test: SourceHistories, representation: Representation
) -> Tensor:
    """States [N, T, C] that start from the true ones."""
    initial = test.parameters[:, 0]
    with torch.no_grad():
        states = roll_out(initial, ntm, rung, representation).states
    return anchored(states, initial, ntm.affine.gain)


def _unflat(flat: Tensor, representation: Representation) -> Latents:
    """Latents from vectors [N, 3 k + d]."""
    color, _ = representation.latent_sizes
    return Latents(flat[:, :color].reshape(len(flat), 3, color // 3), flat[:, color:])


def suffices(scores: Mapping[str, float], sufficient: float) -> bool:
    """Whether a rung reaches `sufficient` dB on all that was held out."""
    return min(scores.values()) >= sufficient


def choose(scores: Mapping[str, Mapping[str, float]], *, sufficient: float, margin: float) -> str:
    """The cheapest rung that suffices, or whose mean score is within `margin` dB of the best mean.

    `scores`: of each rung, dB by what was held out. Means are over texels and ranges alike: a model
    is used on materials like its source and on others. Only rungs that were scored on all of it
    are compared; others were found to be unneeded.
    """
    most = max(map(len, scores.values()))
    means = {
        rung: sum(found.values()) / most for rung, found in scores.items() if len(found) == most
    }
    best = max(means.values())
    return next(
        rung
        for rung in LADDER
        if rung in means and (suffices(scores[rung], sufficient) or means[rung] >= best - margin)
    )
