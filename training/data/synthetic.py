"""The paper's synthetic time-varying materials S1 and S2 (section 4.3), as the paper defines them.

Source and target are different patches of one static material; the target's Kd is offset by delta
and its roughness by beta. Values evolve unclamped from clamped starts; `Sequence.clamped` makes
them fit to be rendered, `Sequence.out_of_range` says which texels that touches.

Both models are channelwise affine in the initial value: z(t) = p(t) z(0) + q(t). A two-number model
per frame and channel reproduces them exactly, so they tell little about a neural one.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from model_runtime.channels import ALPHA_MIN
from model_runtime.errors import InputError
from model_runtime.images import read_image
from model_runtime.maps import TorranceSparrowMaps

from .folder import Crop
from .sequences import Sequence, uniform_times

__all__ = ("S1_DELTA", "from_pbr", "offset", "s1", "s2")

S1_DELTA = (0.1, -0.1, 0.0)
"""The color offset of the target in S1; in S2 it is zero."""


def from_pbr(folder: Path, patch: Crop) -> TorranceSparrowMaps:
    """Initial maps from an ambientCG material (`<Asset>_1K-JPG_Color.jpg` and `_Roughness.jpg`).

    Kd = linear Color, Ks = 0.35 + 0.3 (1 - Roughness) in every channel, alpha = Roughness^2
    (docs/design.md, conventions: the paper does not say). `patch` keeps (rows, columns). Raises
    `InputError` for a missing map or a patch outside it.
    """
    color, roughness = (
        read_image(_only(folder, f"*_{name}.jpg"), color=name == "Color")[patch]
        for name in ("Color", "Roughness")
    )
    wanted = tuple(side.stop - (side.start or 0) for side in patch)
    if color.shape[:2] != wanted or roughness.shape != wanted:
        raise InputError(
            f"The patch of {wanted[1]} x {wanted[0]} texels reaches beyond the maps in {folder}.",
            "Choose a patch inside them.",
        )
    specular = 0.35 + 0.3 * (1 - roughness)
    return _clamped(TorranceSparrowMaps(color, np.repeat(specular[..., None], 3, -1), roughness**2))


def offset(
    initial: TorranceSparrowMaps, *, delta: tuple[float, float, float], beta: float
) -> TorranceSparrowMaps:
    """The target's start: Kd + delta and alpha + beta, clamped to what can be rendered."""
    kd = initial.kd + np.asarray(delta, np.float32)
    return _clamped(replace(initial, kd=kd, alpha=initial.alpha + np.float32(beta)))


def s1(initial: TorranceSparrowMaps, a: float, *, frames: int = 36) -> Sequence:
    """Synthetic temporal model 1 with temporal parameter `a` (the paper's alpha): Kd alone changes.

    Kd_r(t) = Kd_r(0) / (1 + a t)^2
    Kd_g(t) = a t^2 + Kd_g(0) / (1 + a t^2)
    Kd_b(t) = 1.5 Kd_b(0) / (1.5 - a t^2) + a t
    """
    t = uniform_times(frames)[:, None, None]
    red, green, blue = np.moveaxis(initial.kd, -1, 0)
    kd = np.stack(
        (
            red / (1 + a * t) ** 2,
            a * t**2 + green / (1 + a * t**2),
            1.5 / (1.5 - a * t**2) * blue + a * t,
        ),
        axis=-1,
    )
    return _sequence(kd, np.repeat(initial.ks[None], frames, 0), initial.alpha + 0 * t, "S1")


def s2(initial: TorranceSparrowMaps, a: float, *, frames: int = 36) -> Sequence:
    """Synthetic temporal model 2 with temporal parameter `a` (the paper's alpha).

    Kd(t)    = a (c - 0.9 Kd(0)) t + Kd(0),  c = (0.9, 0.4, 0.15)
    Ks(t)    = Ks(0) - 0.3 a t
    sigma(t) = 0.25 a sigma(0) t^2 + 0.5 (1 + a) sigma(0) t + sigma(0)
    """
    t = uniform_times(frames)[:, None, None]
    towards = np.array((0.9, 0.4, 0.15), np.float32) - np.float32(0.9) * initial.kd
    kd = a * towards * t[..., None] + initial.kd
    ks = -0.3 * a * t[..., None] + initial.ks
    alpha = 0.25 * a * initial.alpha * t**2 + 0.5 * (1 + a) * initial.alpha * t + initial.alpha
    return _sequence(kd, ks, alpha, "S2")


def _sequence(kd: np.ndarray, ks: np.ndarray, alpha: np.ndarray, name: str) -> Sequence:
    kd, ks, alpha = (maps.astype(np.float32) for maps in (kd, ks, alpha))
    return Sequence(kd, ks, alpha, uniform_times(len(kd)), None, name)


def _clamped(maps: TorranceSparrowMaps) -> TorranceSparrowMaps:
    kd, ks = np.maximum(maps.kd, 0), np.maximum(maps.ks, 0)
    return TorranceSparrowMaps(kd, ks, np.clip(maps.alpha, ALPHA_MIN, 1))


def _only(folder: Path, pattern: str) -> Path:
    """The one file of a folder that fits a pattern."""
    found = sorted(Path(folder).glob(pattern))
    if len(found) != 1:
        raise InputError(
            f"{folder} holds {len(found)} files named {pattern}.", "It must hold exactly one."
        )
    return found[0]
