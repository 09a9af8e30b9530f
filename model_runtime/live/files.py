"""The files of a live material, beside `aged.json`.

`timing.exr` (absent where the age is the time) is a texture of half floats, `coefficients_0.png
...`, four coefficients each, of bytes; `curves.exr` is a table of single floats (`Curves.packed`),
as is `lobes.exr`, where there are several (`packed_lobes`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..backend import Tensor, torch
from ..brdf.principled import EXACT_F0
from ..channels import LOBE, REFLECTANCES, optics
from ..contract import (
    COEFFICIENTS_A_FILE,
    CURVES,
    LOBES,
    PRINCIPLED_EXACT,
    REPORT,
    TIMING,
    TORRANCE_SPARROW,
    Format,
    coefficients_file,
)
from ..images import read_bytes, read_image
from ..maps import Pixels
from ..modelling.compose import AgedTexels
from ..modelling.residues import HEIGHT_PLACE, Residues
from ..output.stored import StagedResult
from ..states import with_roughness
from .evaluate import BYTES, Curves, LiveMaps, packed_lobes, unpacked_lobes
from .low_rank import MOST_COEFFICIENTS, LowRank

_Value = TypeVar("_Value", np.float16, np.uint8)

__all__ = ("live_names", "read_live", "write_live")

_BAND = 1 << 15  # texels worked on at a time: what they need stays in the cache
_HISTORIES = 1 << 12  # likewise, with all ages
_GRAIN_ZERO, _GRAIN_MOST = 128, 127  # of bytes
_NEAR = 0.25  # of reflectance: texels differ by less from their entry


def live_names() -> list[str]:
    """Every file that a live material may have."""
    return [
        TIMING,
        CURVES,
        LOBES,
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
    if timing is not None:
        files["timing"] = TIMING
        planes = [torch.from_numpy(each.reshape(-1)) for each in timing]
        staged.write(TIMING, _image(planes, timing[0].shape, np.float16), compression="zip")
    elif aged.onset is not None:
        files["timing"] = TIMING
        rate = torch.ones(()) if aged.rate is None else aged.rate
        staged.write(TIMING, _image((aged.onset, rate), size, np.float16), compression="zip")
    curves, coefficients = found.curves(), [*_in_bytes(found, aged)]
    if aged.residues is not None:
        residues = aged.residues.within(MOST_COEFFICIENTS - len(found.shapes))
        curves, own = _with_residues(curves, residues)
        coefficients += own
    files["coefficients"] = []
    for first in range(0, len(coefficients), COEFFICIENTS_A_FILE):
        files["coefficients"].append(coefficients_file(first // COEFFICIENTS_A_FILE))
        planes = coefficients[first : first + COEFFICIENTS_A_FILE]
        staged.write_bytes(files["coefficients"][-1], _image(planes, size, np.uint8))
    if aged.further is not None:
        curves = curves.alone(with_roughness(aged.initial[:1])[0].numpy())
        files["lobes"] = LOBES
        lobes = _lobe_curves(aged.further, len(curves.gain))
        staged.write(LOBES, packed_lobes(lobes), depth="single")
    staged.write(CURVES, curves.packed(), depth="single")
    if format == PRINCIPLED_EXACT and not _representable(found, aged):
        format = TORRANCE_SPARROW
    return format, files


def _in_bytes(found: LowRank, aged: AgedTexels) -> Tensor:
    """The coefficients of `aged` in the sum `found`: bytes [R, n]."""
    coefficients = torch.empty(len(found.shapes), len(aged.initial), dtype=torch.uint8)
    for start in range(0, len(aged.initial), _BAND):
        band = slice(start, start + _BAND)
        coefficients[:, band] = found.bytes_of(aged.initial[band], aged.palette.index[band]).T
    return coefficients


def _with_residues(curves: Curves, residues: Residues) -> tuple[Curves, Tensor]:
    """`curves`, and those of `residues` after them; the coefficients of these as bytes [R, n]."""
    is_grain = torch.arange(len(residues.shapes)) >= len(residues.shapes) - residues.grain
    least, most = (each.float() for each in residues.coefficients.aminmax(dim=1))
    step = torch.where(is_grain, residues.largest / _GRAIN_MOST, (most - least) / 255)
    step = step.clamp_min(1e-6)
    least = torch.where(is_grain, -_GRAIN_ZERO * step, least)
    coefficients = torch.empty(residues.coefficients.shape, dtype=torch.uint8)
    for own, exact, start, each in zip(
        coefficients, residues.coefficients, least, step, strict=True
    ):
        own.copy_(((exact.float() - start) / each).round_())
    ages = torch.linspace(0, 1, len(curves.gain))
    shapes = residues.shapes_at(ages)
    offset = torch.tensordot(least * ~is_grain, shapes, 1)
    offset[:, HEIGHT_PLACE] += residues.height_at(ages)
    shapes *= (255 * step)[:, None, None]
    shapes = np.concatenate((curves.shapes, shapes.numpy()))
    return Curves(curves.gain, curves.offset + offset.numpy(), shapes), coefficients


def _lobe_curves(further: Tensor, count: int) -> Pixels:
    """[K, T, 8] with roughness at `count` T even ages of lobes `further` [ages, K, 8]."""
    even, own = np.linspace(0, 1, count), np.linspace(0, 1, len(further))
    lines = [np.interp(even, own, line) for line in further.flatten(1).T.numpy()]
    curves = np.reshape(lines, (*further.shape[1:], count)).transpose(0, 2, 1).astype(np.float32)
    curves[..., LOBE["alpha"]] **= 0.5
    return curves


def _image(planes: Sequence[Tensor], size: tuple[int, ...], dtype: type[_Value]) -> NDArray[_Value]:
    """[H, W, 3 or more] of planes [H W], or of one value; what is missing is 0."""
    image = np.zeros((max(3, len(planes)), size[0] * size[1]), dtype)
    for channel, plane in zip(torch.from_numpy(image), planes, strict=False):
        channel.copy_(plane)
    return np.moveaxis(image.reshape(-1, *size), 0, -1)


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
    images = [read_bytes(folder / name) for name in files["coefficients"]]
    size, count = tuple(report["size"]), len(curves.shapes)
    lobes = None
    if "lobes" in files:
        lobes = unpacked_lobes(read_image(folder / files["lobes"], color=True))
    coefficients = BYTES.unpacked(images, size, count, report.get("grain", 0))
    return LiveMaps(curves, timing, coefficients, lobes)
