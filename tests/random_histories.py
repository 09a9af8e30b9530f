"""Random maps, and the histories of the texels of a sequence."""

from __future__ import annotations

import numpy as np
import torch

from model_runtime.maps import TorranceSparrowMaps
from training.data.sequences import Sequence


def random_maps(size: int, seed: int) -> TorranceSparrowMaps:
    rng = np.random.default_rng(seed)
    kd, ks = rng.uniform(0.05, 0.6, (2, size, size, 3)).astype(np.float32)
    return TorranceSparrowMaps(kd, ks, rng.uniform(0.05, 0.4, (size, size)).astype(np.float32))


def histories_of(sequence: Sequence) -> torch.Tensor:
    """[N, T, 7]"""
    stacked = np.concatenate((sequence.kd, sequence.ks, sequence.alpha[..., None]), -1)
    return torch.from_numpy(stacked.reshape(len(sequence.times), -1, 7)).transpose(0, 1)
