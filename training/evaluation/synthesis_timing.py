"""When, not only what: spots that start at other times than the first frame can tell."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from model_runtime.compose import AgedTexels
from model_runtime.onset import onset_map, rate_map
from model_runtime.plan import build_palette, clamp_parameters

from ..data.sequences import Sequence
from .synthesis_cases import states_of
from .synthesis_methods import Rung
from .synthesis_stage import Stage
from .synthesis_statistics import map_distances

__all__ = ("STATISTICS", "spot_statistics", "states_with_true_onset")

STATISTICS = ("seeded", "none", "fade", "constant")
"""What is compared with the truth by statistics: the product with its seeded pattern and without
any; the fade that a mean over texels makes, each channel affine in what it was; a still image."""

_SEEDS = (0, 1, 2)
_EVERY = 5


def states_with_true_onset(stage: Stage, rung: Rung, frames: list[int], pixels: Tensor) -> Tensor:
    """States [t, p, 7] of a target whose texels are told when to start."""
    target = stage.case.target
    assert isinstance(target, Sequence) and target.onset is not None
    texels = stage.texels[pixels]
    onset = torch.from_numpy(target.onset).flatten()[texels]
    aged = rung.aged(stage.start[texels], rung.rung(stage), onset=onset)
    return torch.stack([aged.at(frame / (stage.frames - 1)) for frame in frames])


def spot_statistics(stage: Stage, rung: Rung, blind: Rung) -> dict[str, Tensor]:
    """For each of `STATISTICS` [F, 3]: a frame, and the distances of histograms and
    autocorrelations of its maps (see `map_distances`) from the truth's, means over the maps.

    `rung` is what the product uses, `blind` a ladder that knows nothing of onsets. Whole maps are
    compared, their histories shared by a palette as in the product.
    """
    target = stage.case.target
    assert isinstance(target, Sequence)
    shape = target.alpha.shape[1:]
    height, width = int(shape[0]), int(shape[1])
    frames = range(_EVERY, stage.frames, _EVERY)
    truth = clamp_parameters(states_of(target)[list(frames)])
    start = stage.start
    palette = build_palette(start, 0.05, most=256)
    plain = rung.aged(start, rung.rung(stage), palette=palette)
    estimates: dict[str, list[AgedTexels]] = {
        "seeded": [_patterned(plain, stage.case.process, (height, width), s) for s in _SEEDS],
        "none": [plain],
        "fade": [blind.aged(start, "affine", palette=palette)],
        "constant": [rung.aged(start, "constant", palette=palette)],
    }
    found = {}
    for name, variants in estimates.items():
        rows = []
        for frame, true in zip(frames, truth, strict=True):
            time = frame / (stage.frames - 1)
            pairs = [map_distances(true, v.at(time).view(height, width, 7)) for v in variants]
            rows.append((float(frame), *np.mean(pairs, 0).tolist()))
        found[name] = torch.tensor(rows)
    return found


def _patterned(aged: AgedTexels, process: str, shape: tuple[int, int], seed: int) -> AgedTexels:
    """With the product's onset and rate."""
    onset, rate = (make(process, shape, seed=seed) for make in (onset_map, rate_map))
    return AgedTexels(
        aged.initial,
        aged.palette,
        aged.histories,
        aged.gain,
        torch.from_numpy(onset).flatten(),
        torch.from_numpy(rate).flatten(),
    )
