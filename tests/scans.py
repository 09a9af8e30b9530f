"""Made-up scans of which everything is known: folders of steel with round patches of rust."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Array = NDArray[np.float32]

STEEL, RUST = (0.55, 0.56, 0.58), (0.25, 0.10, 0.05)
"""Linear base colors."""

_PATCHES = ((0.25, 0.3, 0.14), (0.7, 0.62, 0.2), (0.3, 0.95, 0.12))
_WIDTH = 3.0  # texels over which steel becomes rust
_LIP = 0.25


@dataclass(frozen=True)
class MadeScan:
    """distance [H, W] in texels from the border of what is rusted, positive inside."""

    folder: Path
    distance: Array

    @property
    def rusted(self) -> NDArray[np.bool_]:
        return self.distance > 0


def srgb(linear: Array) -> Array:
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def save(path: Path, values: Array) -> None:
    Image.fromarray(np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)).save(path)


def write_scan(folder: Path, *, side: int = 192, seed: int = 0, grain: float = 0.12) -> MadeScan:
    """A scan that wraps, with displacement that has a lip of lifted steel around each patch."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    y, x = (np.mgrid[:side, :side] + 0.5) / side
    distance = np.full((side, side), -1.0)
    for row, column, radius in _PATCHES:
        away = [np.abs(each - middle) for each, middle in ((y, row), (x, column))]
        off = np.hypot(*(np.minimum(each, 1 - each) for each in away))
        distance = np.maximum(distance, radius - off)
    distance = (distance * side).astype(np.float32)
    share = 1 / (1 + np.exp(-4 * distance / _WIDTH))
    spots = rng.standard_normal((side, side))
    spots = np.fft.ifft2(np.fft.fft2(spots) * _band(side)).real
    spots /= spots.std()
    rust = np.array(RUST) * np.exp(grain * spots)[..., None]
    color = np.array(STEEL) * (1 - share[..., None]) + rust * share[..., None]
    save(folder / "plate_Color.png", srgb(color))
    save(folder / "plate_Roughness.png", 0.3 + (0.55 + 0.05 * spots) * share)
    save(folder / "plate_Metalness.png", 1 - share)
    lip = _LIP * np.exp(-(((distance + 4) / 2.5) ** 2))
    save(folder / "plate_Displacement.png", 0.5 + lip - 0.3 * share + 0.02 * spots * share)
    return MadeScan(folder, distance)


def write_plain(folder: Path, *, side: int = 128, noise: float = 0.0, seed: int = 0) -> Path:
    """One kind of surface, evenly or from texel to texel."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    color = 0.5 + noise * rng.standard_normal((side, side, 1))
    save(folder / "plain_Color.png", np.repeat(color, 3, -1))
    return folder


def _band(side: int) -> Array:
    """Waves of about eight texels."""
    frequency = np.fft.fftfreq(side)
    radius = np.hypot(frequency[:, None], frequency)
    return np.exp(-(((radius - 1 / 8) / 0.06) ** 2))
