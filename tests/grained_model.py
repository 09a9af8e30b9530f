"""Bundled rust with made-up grain and relief: a model file of version 2, to try things with.

python -m tests.grained_model FILE
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model_runtime.backend import torch
from model_runtime.model_files.weights import MODELS, read_card, save_model
from model_runtime.temporal.grain import Grain
from model_runtime.temporal.ntm import NeuralTemporalModel

_FADE_IN = 0.4  # age from which on grain is whole
_DEEPEST = 0.012  # of relief, in sides of the tile


def gaussian_tile(side: int, *, seed: int = 0) -> NDArray[np.uint8]:
    """[3, S, S]: clumps of three sizes that wrap."""
    rng = np.random.default_rng(seed)
    frequency = np.fft.fftfreq(side) * side
    radius = np.hypot(frequency[:, None], frequency)
    planes = []
    for center in (14.0, 5.0, 40.0):  # cycles a tile
        band = np.exp(-0.5 * (np.log2((radius + 1e-6) / center) / 0.9) ** 2)
        noise = np.fft.ifft2(np.fft.fft2(rng.standard_normal((side, side))) * band).real
        planes.append((noise - noise.mean()) / noise.std())
    return np.rint((np.clip(planes, -4, 4) / 4 + 1) / 2 * 255).astype(np.uint8)


def skewed_table() -> NDArray[np.float32]:
    """[3, 256]: a few strong spots among many weak ones, plain noise, and two kinds of texels."""
    gaussian = np.linspace(-4, 4, 256)
    density = np.exp(-(gaussian**2) / 2)
    density /= density.sum()
    tables = np.stack((np.exp(0.6 * gaussian), gaussian, np.tanh(2 * gaussian)))
    tables -= (tables * density).sum(1, keepdims=True)
    tables /= np.sqrt((tables**2 * density).sum(1, keepdims=True))
    return tables.astype(np.float32)


def grain(frames: int, *, side: int = 512) -> Grain:
    """Brown spots that are rougher and stand out; patches of shade; a fine rustle."""
    strength = np.clip(np.linspace(0, 1, frames) / _FADE_IN, 0, 1)
    components = np.array(
        [
            [0.06, 0.022, 0.006, 0.004, 0.002, 0.001, 0.03, 0.0016],
            [0.035, 0.018, 0.010, 0.003, 0.003, 0.003, -0.05, -0.0022],
            [0.012, 0.010, 0.009, 0.004, 0.004, 0.004, 0.04, 0.0006],
        ]
    )
    shapes = (strength[:, None, None] * components).astype(np.float32)
    return Grain(gaussian_tile(side), skewed_table(), shapes, share=0.5)


def height(frames: int) -> torch.Tensor:
    """[T]: what weathers blisters first, and is gone then."""
    age = np.linspace(0, 1, frames)
    lifted = 0.5 * np.exp(-(((age - 0.2) / 0.1) ** 2)) * np.minimum(1, age / 0.05)
    gone = np.clip((age - 0.3) / 0.3, 0, 1) ** 2
    return torch.from_numpy((_DEEPEST * (lifted - gone)).astype(np.float32))


def with_grain(ntm: NeuralTemporalModel, *, side: int = 512) -> NeuralTemporalModel:
    """`ntm` with grain and relief."""
    return replace(ntm, grain=grain(ntm.frames, side=side), height=height(ntm.frames))


def write_grained_model(path: Path, *, bundled: str = "rust", side: int = 512) -> Path:
    """The bundled model of that name with grain and relief, called `grained`, as `path`."""
    file = MODELS / f"{bundled}.safetensors"
    card = read_card(file)
    ntm = with_grain(NeuralTemporalModel.load(file, card.representation), side=side)
    details = {
        **card.details,
        "name": "grained",
        "title": f"{card.title} (grained)",
        "grain": {"share": ntm.grain.share if ntm.grain else 1},
        "sources": [{"name": "made up", "license": "CC0-1.0", "credit": "nobody"}],
    }
    save_model(path, ntm.tensors(), json.loads(json.dumps(details)), kind="ntm")
    return path


if __name__ == "__main__":
    print(write_grained_model(Path(sys.argv[1])))
