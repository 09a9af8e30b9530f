"""Stresses of the input: the target's first frame as noise, files and faults leave it.

Methods are given what is left; the truth is the history of the undamaged material.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from model_runtime.channels import ALPHA_MIN
from model_runtime.maps import TorranceSparrowMaps

from ...data.synthetic import from_pbr
from .trials import Stress, Trial, TrialSetup

__all__ = ("INPUTS",)

_SEED = 20240715


def _noise(setup: TrialSetup, percent: float) -> Trial:
    """Every value off by a normal share of itself; what falls below 0 is 0."""
    rng = np.random.default_rng(_SEED)
    start, strength = setup.start, np.float32(percent / 100)

    def noisy(maps: NDArray[np.float32]) -> NDArray[np.float32]:
        off = 1 + strength * rng.standard_normal(maps.shape, np.float32)
        return np.maximum(maps * off, 0)

    damaged = start.map(noisy)
    return Trial(setup.case(), given=replace(damaged, alpha=np.clip(damaged.alpha, ALPHA_MIN, 1)))


def _bits(setup: TrialSetup, bits: float) -> Trial:
    """Color (in sRGB) and roughness, each rounded to so many bits a channel."""
    levels = 2 ** int(bits) - 1

    def coarse(image: Image.Image) -> Image.Image:
        codes = np.rint(np.asarray(image, np.float64) / 255 * levels) / levels
        return Image.fromarray(np.rint(255 * codes).astype(np.uint8))

    return Trial(setup.case(), given=_stored_again(setup, coarse))


def _jpeg(setup: TrialSetup, quality: float) -> Trial:
    """Color and roughness saved once more as JPEG."""

    def saved(image: Image.Image) -> Image.Image:
        file = io.BytesIO()
        image.save(file, "JPEG", quality=int(quality))
        return Image.open(file).convert(image.mode)

    return Trial(setup.case(), given=_stored_again(setup, saved))


def _stored_again(setup: TrialSetup, change) -> TorranceSparrowMaps:
    """The target from its images, each put through `change`."""
    folder = setup.data / "pbr" / TrialSetup.MATERIAL
    with tempfile.TemporaryDirectory() as copies:
        for name in ("Color", "Roughness"):
            (path,) = folder.glob(f"*_{name}.jpg")
            with Image.open(path) as image:
                image = image.crop(setup.target_box).convert("RGB" if name == "Color" else "L")
            change(image).save(Path(copies) / f"{path.stem}.png")
            (Path(copies) / f"{path.stem}.png").rename(Path(copies) / path.name)
        whole = slice(0, setup.size)
        return from_pbr(Path(copies), (whole, whole))


def _share(setup: TrialSetup, share: float, value: float) -> Trial:
    """A share of the texels, at least one where it is not 0, with `value` in every map."""
    count = setup.size**2
    rng = np.random.default_rng(_SEED)
    hit = np.zeros(count, bool)
    hit[rng.permutation(count)[: int(np.ceil(share * count))]] = True
    there = hit.reshape(setup.size, setup.size)
    return Trial(setup.case(), given=_with(setup.start, there, value))


def _broken(setup: TrialSetup, value: float) -> Trial:
    """One texel whose Kd and Ks are `value` and whose alpha is 1e-4 or 1; it does not count."""
    there = np.zeros((setup.size, setup.size), bool)
    there[setup.size // 2, setup.size // 2] = True
    broken = _with(setup.start, there, value)
    alpha = np.where(there, np.float32(1 if value > 1 else ALPHA_MIN), setup.start.alpha)
    return Trial(setup.case(), given=replace(broken, alpha=alpha), unscored=there)


def _with(start: TorranceSparrowMaps, there: NDArray[np.bool_], value: float):
    def put(maps: NDArray[np.float32]) -> NDArray[np.float32]:
        where = there[..., None] if maps.ndim == 3 else there
        return np.where(where, np.float32(value), maps)

    return start.map(put)


_SHARES = (0.0, 1e-4, 0.1, 1.0)
_REFUSED = "the product refuses such maps, and says where the first such texel is"

INPUTS: Mapping[str, Stress] = {
    "noise": Stress(
        "noise on the input", "% of each value", (0.0, 5.0, 10.0, 20.0, 40.0, 80.0, 160.0), _noise
    ),
    "bits": Stress(
        "8-bit input and coarser", "bits a channel", (8.0, 6.0, 5.0, 4.0, 2.0, 1.0), _bits
    ),
    "jpeg": Stress("JPEG input", "quality", (95.0, 50.0, 25.0, 10.0, 1.0), _jpeg),
    "nan": Stress(
        "NaN texels", "share of texels", _SHARES,
        lambda setup, share: _share(setup, share, np.nan), note=_REFUSED,
    ),
    "infinite": Stress(
        "infinite texels", "share of texels", _SHARES,
        lambda setup, share: _share(setup, share, np.inf), note=_REFUSED,
    ),
    "negative": Stress(
        "negative texels", "share of texels", _SHARES,
        lambda setup, share: _share(setup, share, -1.0), note=_REFUSED,
    ),
    "broken_texel": Stress(
        "one broken texel, the others' picture", "its Kd and Ks",
        (0.5, 10.0, 1e3, 65504.0), _broken,
    ),
}  # fmt: skip
"""By name."""
