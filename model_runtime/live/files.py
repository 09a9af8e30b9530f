"""The files of a live material, beside `aged.json`.

`timing.exr` (absent where the age is the time) and `coefficients_0.exr ...`, three coefficients
each, are textures of half floats; `curves.exr` is a table of single floats (`Curves.packed`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..brdf import principled
from ..compose import AgedTexels
from ..images import read_image
from ..maps import Halves, TorranceSparrowMaps
from ..result import REPORT, StagedResult
from ..writing import Format
from .evaluate import COEFFICIENTS_A_FILE, Curves, LiveMaps
from .low_rank import LowRank, with_roughness

__all__ = ("CURVES", "TIMING", "read_live", "write_live")

CURVES = "curves.exr"
TIMING = "timing.exr"

_BAND = 1 << 12  # texels whose whole histories are looked at together


def write_live(
    found: LowRank,
    aged: AgedTexels,
    size: tuple[int, int],
    format: Format,
    staged: StagedResult,
) -> tuple[Format, dict[str, Any]]:
    """Write what a shader needs to show `aged`, an image of `size`, as the sum `found`; returns
    the format it is to show it in and `files` of `aged.json`.

    "principled-exact" is replaced by "torrance-sparrow" where any texel at any age is beyond what
    it can hold.
    """
    files: dict[str, Any] = {"curves": CURVES}
    staged.write(CURVES, found.curves().packed(), depth="single")
    if aged.onset is not None:
        files["timing"] = TIMING
        rate = torch.ones(()) if aged.rate is None else aged.rate
        staged.write(TIMING, _image((aged.onset, rate), size))
    files["coefficients"] = []
    halves = found.coefficients.half()
    for start in range(0, halves.shape[1], COEFFICIENTS_A_FILE):
        name = f"coefficients_{start // COEFFICIENTS_A_FILE}.exr"
        files["coefficients"].append(name)
        some = halves[:, start : start + COEFFICIENTS_A_FILE].unbind(1)
        staged.write(name, _image([each[aged.palette.index] for each in some], size))
    if format == "principled-exact" and not _representable(found, aged):
        format = "torrance-sparrow"
    return format, files


def _image(planes: Sequence[Tensor], size: tuple[int, int]) -> Halves:
    """[H, W, 3] of at most three planes [H W], or of one value; what is missing is 0."""
    image = torch.zeros(3, size[0] * size[1], dtype=torch.half)
    for channel, plane in zip(image, planes, strict=False):
        channel.copy_(plane)
    return np.moveaxis(image.numpy().reshape(3, *size), 0, -1)


def _representable(found: LowRank, aged: AgedTexels) -> bool:
    """Whether "principled-exact" can hold the sum of every texel at every age."""
    for rows in torch.arange(len(aged.initial)).split(_BAND):
        start = with_roughness(aged.initial[rows])
        states = found.at_ages(start, aged.palette.index[rows]).flatten(0, 1).numpy()
        kd, ks, r = states[None, :, :3], states[None, :, 3:6], states[None, :, 6]
        if not principled.representable(TorranceSparrowMaps(kd, ks, np.square(r))):
            return False
    return True


def read_live(folder: Path) -> LiveMaps:
    """What `write_live` wrote to `folder`."""
    report = json.loads((folder / REPORT).read_text(encoding="utf-8"))
    files: Mapping[str, Any] = report["files"]
    curves = Curves.unpacked(read_image(folder / files["curves"], color=True))
    timing = read_image(folder / files["timing"], color=True) if "timing" in files else None
    height, width = report["size"]
    images = [read_image(folder / name, color=True) for name in files["coefficients"]]
    coefficients = np.concatenate((np.empty((height, width, 0), np.float32), *images), -1)
    return LiveMaps(curves, timing, coefficients[..., : len(curves.shapes)])
