"""What live sums start from, and how they compare with frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from model_runtime.backend import torch
from model_runtime.brdf import principled
from model_runtime.maps import PrincipledMaps
from model_runtime.reading.inputs import read_input


def start_of(folder: Path, size: int | None = None) -> np.ndarray:
    """[H, W, 7] (kd, ks, r) of a Principled material, read forward."""
    material = read_input(folder, size=size)
    assert isinstance(material, PrincipledMaps)
    maps = principled.forward(material)
    return np.concatenate((maps.kd, maps.ks, material.roughness[..., None]), -1)


def as_parameters(states: np.ndarray) -> torch.Tensor:
    """(kd, ks, alpha) [n, 7] of (kd, ks, r) [H, W, 7]."""
    flat = torch.from_numpy(states.reshape(-1, 7))
    return torch.cat((flat[:, :6], flat[:, 6:].square()), -1)
