"""Statistics of textures, for histories that cannot agree texel by texel: where spots start at
other times and places than the first frame can tell, a map is as good as it is distributed, and as
it is patterned.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from model_runtime.modelling.compose import AgedTexels
from model_runtime.modelling.palette import Palette, build_palette
from model_runtime.states import clamped, perceptual
from model_runtime.temporal.models import Affine
from model_runtime.temporal.onset import onset_map, rate_map

from ...data.sequences import Sequence
from ...source.onsets import radial_covariance
from ..bench.aging import texels_of
from .methods import Rung
from .stage import Stage

__all__ = (
    "STATISTICS",
    "Rows",
    "autocorrelation_distance",
    "histogram_distance",
    "map_distances",
    "spot_statistics",
    "states_with_true_onset",
)

STATISTICS = ("seeded", "estimated", "none", "fade", "constant")
"""What is compared with the truth by statistics: the product with its seeded pattern; the same
where the source's onset was hidden and had to be estimated (only if it has one); the product
without any; the fade that a mean over texels makes, each channel affine in what it was; a still
image."""

_SEEDS = (0, 1, 2)
_EVERY = 5
Rows = list[list[float]]

_LEVELS = 256
_FLAT = 1e-6


def histogram_distance(first: NDArray[np.floating], second: NDArray[np.floating]) -> float:
    """The area between the cumulative histograms of two maps [H, W] of any sizes: the mean way that
    values must move to turn one into the other (Wasserstein's first distance).
    """
    share = (np.arange(_LEVELS) + 0.5) / _LEVELS
    return float(np.abs(np.quantile(first, share) - np.quantile(second, share)).mean())


def autocorrelation_distance(first: NDArray[np.floating], second: NDArray[np.floating]) -> float:
    """Mean difference, over distances of up to a quarter of the shorter side, of how alike texels
    at that distance are in two maps [H, W] of one size.

    Alike is the covariance over all directions, divided by the larger of the two variances, so that
    a map that hardly varies is not like one that does, whatever its pattern. 0 to 2; 0 for equal
    maps, and for two without any variation.
    """
    a, b = radial_covariance(first), radial_covariance(second)
    larger = max(a[0], b[0])
    return 0.0 if larger < _FLAT else float(np.abs(a - b).mean() / larger)


def map_distances(truth: Tensor, estimate: Tensor) -> tuple[float, float]:
    """Histogram and autocorrelation distance of two textures [H, W, C], each the
    mean over the maps that the truth does not leave at 0; values are square roots, as the eye sees.
    """
    a, b = (perceptual(values, most=math.inf).numpy() for values in (truth, estimate))
    maps = [i for i in range(a.shape[-1]) if a[..., i].any() or b[..., i].any()]
    return (
        float(np.mean([histogram_distance(a[..., i], b[..., i]) for i in maps])),
        float(np.mean([autocorrelation_distance(a[..., i], b[..., i]) for i in maps])),
    )


def states_with_true_onset(stage: Stage, rung: Rung, frames: list[int], pixels: Tensor) -> Tensor:
    """States [t, p, C] of a target whose texels are told when to start."""
    target = stage.case.target
    assert isinstance(target, Sequence) and target.onset is not None
    texels = stage.texels[pixels]
    onset = torch.from_numpy(target.onset).flatten()[texels]
    aged = rung.aged(stage.start[texels], rung.rung(stage), onset=onset)
    return torch.stack([aged.at(frame / (stage.frames - 1)) for frame in frames])


def spot_statistics(stage: Stage, rung: Rung, estimated: Rung | None = None) -> dict[str, Rows]:
    """For each of `STATISTICS` [F][3]: a frame, and the distances of histograms and
    autocorrelations of its maps (see `map_distances`) from the truth's, means over the maps.

    `rung` is what the product uses, `estimated` the same where it had to estimate onsets that were
    hidden from it. Whole maps are compared, their histories shared by a palette as in the product.
    """
    source, target = stage.case.source, stage.case.target
    assert isinstance(source, Sequence) and isinstance(target, Sequence)
    shape = target.alpha.shape[1:]
    height, width = int(shape[0]), int(shape[1])
    frames = range(_EVERY, stage.frames, _EVERY)
    truth = clamped(texels_of(target)[list(frames)])
    start = stage.start
    palette = build_palette(start, 0.05, most=256)
    size = (height, width)
    estimates: dict[str, list[AgedTexels]] = {
        "seeded": _patterned(stage, rung, palette, size),
        "none": [rung.aged(start, rung.rung(stage), palette=palette)],
        "fade": [_fading(source, rung).aged(start, "affine", palette=palette)],
        "constant": [rung.aged(start, "constant", palette=palette)],
    }
    if estimated is not None:
        estimates["estimated"] = _patterned(stage, estimated, palette, size)
    found = {}
    for name, variants in estimates.items():
        rows = []
        for frame, true in zip(frames, truth, strict=True):
            time = frame / (stage.frames - 1)
            pairs = [map_distances(true, v.at(time).view(*size, -1)) for v in variants]
            rows.append((float(frame), *np.mean(pairs, 0).tolist()))
        found[name] = torch.tensor(rows).tolist()
    return found


def _fading(source: Sequence, rung: Rung) -> Rung:
    """`rung` with an affine model of change that knows nothing of onsets."""
    histories = clamped(texels_of(source)).flatten(1, 2).transpose(0, 1)
    seen = torch.from_numpy(~source.out_of_range()).flatten(1).T
    card = replace(rung.ntm.card, details={**rung.ntm.card.details, "timing": None})
    return replace(rung, ntm=replace(rung.ntm, card=card, affine=Affine.fit(histories, seen)))


def _patterned(
    stage: Stage, rung: Rung, palette: Palette, size: tuple[int, int]
) -> list[AgedTexels]:
    """With the product's onset and rate, for each of `_SEEDS`."""
    timing, process = rung.ntm.timing, stage.case.process
    variants = []
    for seed in _SEEDS:
        onset, rate = (
            torch.from_numpy(make(process, size, seed=seed, timing=timing)).flatten()
            for make in (onset_map, rate_map)
        )
        chosen = rung.rung(stage)
        variants.append(rung.aged(stage.start, chosen, palette=palette, onset=onset, rate=rate))
    return variants
