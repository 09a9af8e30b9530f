"""The relief of a scan, from its displacement and its normals.

Normals are slopes, in units that need no scale; displacement is height in an unknown one. Where
both are there, the depth of the displacement is what makes its slopes those of the normals; where
there are only normals, they are integrated (Frankot and Chellappa 1988). The form of the thing
(corrugation, boards, a warped plate) is what its clean parts show, smoothed and carried on under
the weathered ones; relief is counted from there.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model_runtime.images import read_image, read_packed
from model_runtime.reading.texture_names import choose_relief, points_down
from model_runtime.resampling import resize

from .distance import Wraps, smoothed

__all__ = ("Relief", "from_steps", "read_relief", "without_form")

Array = NDArray[np.float32]
Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

ASSUMED_DEPTH = 0.01
"""Of a displacement map's range, in sides of the scan, where no normals tell."""

_FORM = 1 / 24  # of the scan's side: larger waves are the thing's form, not its weathering
_FARTHER = 4  # times as far clean texels are looked for where there are none
_SELDOM = 0.03  # how much those count
_STEEPEST = 4.0  # a slope that a normal map holds for sure
_LEAST_AGREEMENT = 0.3  # correlation of slopes below which normals and displacement differ
_DEPTH = (0.003, 0.1)  # of the scan's side; many normal maps are shallower than one can see


@dataclass(frozen=True)
class Relief:
    """height: [H, W] in texels, of zero mean; None where nothing tells of it. `told` says in one
    sentence where it comes from.
    """

    height: Array | None
    told: str


def read_relief(folder: Path, size: tuple[int, int], wraps: Wraps) -> Relief:
    """The relief of the texture folder at `size` (height, width)."""
    files = choose_relief(sorted(entry.name for entry in folder.iterdir()))
    slopes = _slopes(folder / files["normal"], size) if "normal" in files else None
    if "height" not in files:
        if slopes is None:
            return Relief(None, "Nothing tells of its relief: none was learned.")
        return Relief(_integrated(*slopes, wraps), "Its relief was integrated from its normals.")
    shape = resize(read_image(folder / files["height"], color=False), size)
    depth = None if slopes is None else _depth(shape, slopes, wraps)
    if depth is None:
        depth = ASSUMED_DEPTH * max(size)
        told = f"Its displacement was assumed to range over {ASSUMED_DEPTH:.1%} of its side."
    else:
        shown = depth / max(size)
        depth = float(np.clip(shown, *_DEPTH)) * max(size)
        told = f"Its displacement ranges over {shown:.2%} of its side, as its normals say"
        told += "." if shown >= _DEPTH[0] else f", and was taken for {_DEPTH[0]:.1%}."
    return Relief(shape * np.float32(depth), told)


def _slopes(file: Path, size: tuple[int, int]) -> tuple[Array, Array]:
    """How steeply height rises (down the rows, along the columns), texels a texel."""
    normal = resize(read_packed(file), size) * 2 - 1
    up = np.maximum(normal[..., 2], 1 / _STEEPEST / 2)
    green = normal[..., 1] / up * (-1 if points_down(file.name) else 1)
    down, across = green, -normal[..., 0] / up  # green points up, rows count down
    return tuple(
        np.clip(slope - slope.mean(), -_STEEPEST, _STEEPEST).astype(np.float32)
        for slope in (down, across)
    )  # type: ignore[return-value]


def _depth(shape: Array, slopes: tuple[Array, Array], wraps: Wraps) -> float | None:
    """What `shape` is to be multiplied by to have `slopes`; None where they do not agree."""
    mine = np.stack(np.gradient(smoothed(shape, 1.0, wraps)))
    theirs = np.stack([smoothed(slope, 1.0, wraps) for slope in slopes])
    power, steep, common = (
        float((first * second).sum())
        for first, second in ((mine, mine), (theirs, theirs), (mine, theirs))
    )
    if power == 0 or common < _LEAST_AGREEMENT * np.sqrt(power * steep):
        return None
    return float(np.sqrt(steep / power))  # a least-squares fit is too flat where slopes are noisy


def _integrated(down: Array, across: Array, wraps: Wraps) -> Array:
    """The height whose slopes are nearest to these."""
    height, width = down.shape
    if not all(wraps):  # mirrored, so that what does not go on does not jump
        down = np.concatenate((down, -down[::-1]), 0)
        down = np.concatenate((down, down[:, ::-1]), 1)
        across = np.concatenate((across, across[::-1]), 0)
        across = np.concatenate((across, -across[:, ::-1]), 1)
    v, u = _waves(down.shape)
    return _nearest(down, across, 1j * v, 1j * u)[:height, :width]


def from_steps(down: Array, across: Array) -> Array:
    """The height [H, W], of zero mean, of a tile that wraps whose steps to the next texel down and
    across are nearest to these.
    """
    v, u = _waves(down.shape)
    return _nearest(down, across, np.expm1(1j * v), np.expm1(1j * u))


def _waves(size: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Down [H, 1] and across [W // 2 + 1], in radians a texel, as `rfft2` has them."""
    v, u = np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1])
    return 2 * np.pi * v, 2 * np.pi * u


def _nearest(down: Array, across: Array, v: Complex, u: Complex) -> Array:
    """What comes nearest to having these, where a wave is multiplied by `v` and `u` to have its."""
    power = np.abs(v) ** 2 + np.abs(u) ** 2
    power[0, 0] = 1
    spectrum = (v.conj() * np.fft.rfft2(down) + u.conj() * np.fft.rfft2(across)) / power
    spectrum[0, 0] = 0
    return np.fft.irfft2(spectrum, down.shape).astype(np.float32)


def without_form(height: Array, clean: NDArray[np.bool_], wraps: Wraps) -> Array:
    """`height` [H, W] above the form that its `clean` texels [H, W], at least one, show."""
    weight = clean.astype(np.float32)
    sigma = _FORM * max(height.shape)
    form = _SELDOM * _broad(weight * height, _FARTHER * sigma, wraps)
    known = _SELDOM * _broad(weight, _FARTHER * sigma, wraps)
    form += _broad(weight * height, sigma, wraps)
    known += _broad(weight, sigma, wraps)
    mean = float(height[clean].mean())
    return height - (form + 1e-4 * mean) / (known + 1e-4)


def _broad(values: Array, sigma: float, wraps: Wraps) -> Array:
    """`values` [H, W] after a Gaussian of many texels, which needs no fine grid."""
    step = max(1, int(sigma // 4))
    size = values.shape[0], values.shape[1]
    coarse = resize(values, (max(1, size[0] // step), max(1, size[1] // step)))
    return resize(smoothed(coarse, sigma / step, wraps), size)
