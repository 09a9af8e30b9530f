"""The files of a live material, beside `aged.json`.

`timing.exr` (absent where the age is the time) and `coefficients_0.exr ...`, three coefficients
each, are textures of half floats; `curves.exr` is a table of single floats (`Curves.packed`).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..backend import Tensor, torch
from ..brdf.principled import EXACT_F0
from ..channels import REFLECTANCES, optics
from ..contract import (
    COEFFICIENTS_A_FILE,
    CURVES,
    PRINCIPLED_EXACT,
    REPORT,
    TIMING,
    TORRANCE_SPARROW,
    Format,
    coefficients_file,
)
from ..images import read_image
from ..maps import Halves, Pixels
from ..modelling.compose import AgedTexels
from ..modelling.residues import HEIGHT_PLACE, Residues
from ..output.stored import StagedResult
from .evaluate import Curves, LiveMaps
from .low_rank import MOST_COEFFICIENTS, LowRank

__all__ = ("live_names", "read_live", "write_live")

_BAND = 1 << 15  # texels worked on at a time: what they need stays in the cache
_HISTORIES = 1 << 12  # likewise, with all ages
_FINEST = 4096.0  # steps of a coefficient, which is at most about 1: digits beyond only cost space
_NEAR = 0.25  # of reflectance: texels differ by less from their entry


def live_names() -> list[str]:
    """Every file that a live material may have."""
    return [
        TIMING,
        CURVES,
        *map(coefficients_file, range(MOST_COEFFICIENTS // COEFFICIENTS_A_FILE)),
    ]


def write_live(
    found: LowRank,
    aged: AgedTexels,
    size: tuple[int, int],
    format: Format,
    staged: StagedResult,
    timing: tuple[Pixels, Pixels] | None = None,
) -> tuple[Format, dict[str, Any]]:
    """Write what a shader needs to show `aged`, an image of `size`, as the sum `found`; returns
    the format it is to show it in and `files` of `aged.json`.

    `timing`: onset and rate [H, W] of a layout of their own, instead of those of the texels.
    "principled-exact" is replaced by "torrance-sparrow" where any texel at any age is beyond what
    it can hold.
    """
    files: dict[str, Any] = {"curves": CURVES}
    residues = aged.residues and aged.residues.within(MOST_COEFFICIENTS - len(found.shapes))
    curves = _with_residues(found.curves(), residues)
    staged.write(CURVES, curves.packed(), depth="single")
    if timing is not None:
        files["timing"] = TIMING
        planes = (torch.from_numpy(each.reshape(-1)) for each in timing)
        staged.write(TIMING, _image(planes, timing[0].shape), compression="zip")
    elif aged.onset is not None:
        files["timing"] = TIMING
        rate = torch.ones(()) if aged.rate is None else aged.rate
        staged.write(TIMING, _image((aged.onset, rate), size), compression="zip")
    coefficients = torch.empty(len(curves.shapes), len(aged.initial), dtype=torch.half)
    for start in range(0, len(aged.initial), _BAND):
        band = slice(start, start + _BAND)
        found_here = found.of(aged.initial[band], aged.palette.index[band])
        own = [found_here.T]
        if residues is not None and len(residues.shapes):
            own.append(residues.coefficients[:, band] / residues.largest[:, None])
        coefficients[:, band] = (torch.cat(own) * _FINEST).round().div(_FINEST)
    files["coefficients"] = []
    for first in range(0, len(coefficients), COEFFICIENTS_A_FILE):
        files["coefficients"].append(coefficients_file(first // COEFFICIENTS_A_FILE))
        some = _image(coefficients[first : first + COEFFICIENTS_A_FILE], size)
        staged.write(files["coefficients"][-1], some, compression="zip")
    if format == PRINCIPLED_EXACT and not _representable(found, aged):
        format = TORRANCE_SPARROW
    return format, files


def _with_residues(curves: Curves, residues: Residues | None) -> Curves:
    """`curves`, and those of `residues` after them, for coefficients of at most 1."""
    if residues is None:
        return curves
    ages = torch.linspace(0, 1, len(curves.gain))
    offset = curves.offset.copy()
    offset[:, HEIGHT_PLACE] = residues.height_at(ages).numpy()
    shapes = residues.shapes_at(ages) * residues.largest[:, None, None]
    return Curves(curves.gain, offset, np.concatenate((curves.shapes, shapes.numpy())))


def _image(planes: Iterable[Tensor], size: tuple[int, ...]) -> Halves:
    """[H, W, 3] of at most three planes [H W], or of one value; what is missing is 0."""
    image = torch.zeros(3, size[0] * size[1], dtype=torch.half)
    for channel, plane in zip(image, planes, strict=False):
        channel.copy_(plane)
    return np.moveaxis(image.numpy().reshape(3, *size), 0, -1)


def _representable(found: LowRank, aged: AgedTexels) -> bool:
    """Whether "principled-exact" can hold the sum of every texel at every age."""
    entries, index = aged.palette.entries, aged.palette.index
    headroom = torch.cat(
        [
            _headroom(found, entries[band], band)
            for band in torch.arange(len(entries)).split(_HISTORIES)
        ]
    )
    # Only texels of entries that come near to the limit can be beyond it.
    near = (headroom < _NEAR + _most_added(aged.residues))[index].nonzero()[:, 0]
    return all(
        bool((_headroom(found, aged.initial[rows], index[rows], some) >= 0).all())
        for rows in near.split(_HISTORIES)
        for some in (None if aged.residues is None else aged.residues.select(rows),)
    )


def _most_added(residues: Residues | None) -> float:
    """What `residues` add to a reflectance at most."""
    if residues is None:
        return 0.0
    added = residues.shapes[..., REFLECTANCES].abs() * residues.largest[:, None, None]
    return 2 * float(added.sum(0).max())


def _headroom(
    found: LowRank, initial: Tensor, entry: Tensor, residues: Residues | None = None
) -> Tensor:
    """[n]: how far texels stay, at every age, below what "principled-exact" can hold."""
    states = found.at_ages(initial, entry)
    if residues is not None and len(residues.shapes):
        shapes = residues.shapes_at(found.ages)[..., :HEIGHT_PLACE]
        states = states + torch.tensordot(residues.coefficients.T.float(), shapes, 1)
    kd, ks, _ = optics(states)
    strongest = ks.amax(-1)
    return torch.minimum(EXACT_F0 - strongest, 1 - strongest - kd.amax(-1)).amin(1)


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
