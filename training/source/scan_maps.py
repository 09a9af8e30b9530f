"""A scan as it is learned from: its texels' states and relief, and what tells kinds apart."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model_runtime.brdf.measured import MeasuredBRDF
from model_runtime.brdf.principled import forward
from model_runtime.errors import InputError, shown
from model_runtime.images import EXTENSIONS, read_image
from model_runtime.maps import Maps, PrincipledMaps
from model_runtime.reading.inputs import read_input
from model_runtime.resampling import resize

from .distance import Wraps, smoothed
from .relief import read_relief

__all__ = ("HEIGHT", "LARGEST", "ROUGHNESS", "ScanMaps", "features", "read_scan")

Array = NDArray[np.float32]

LARGEST = 1024
"""Texels along the longer side that are learned from; larger scans are made smaller."""

ROUGHNESS, HEIGHT = 6, 7
"""Channels of a texel's `values` that are no color: r = sqrt(alpha), and height."""

_LEAST = 32
_PHOTO_ROUGHNESS = 0.5
_SMOOTH = 1.5  # texels
_CHROMA = 2.5  # a step of hue tells kinds apart better than one of lightness
_ROUGH = 0.5
_METAL = 0.5
_JUMP = 2.0  # times the usual step, from which on a side does not go on at the other

# Oklab (Ottosson 2020)
_TO_CONES = np.array(
    (
        (0.4122214708, 0.5363325363, 0.0514459929),
        (0.2119034982, 0.6806995451, 0.1073969566),
        (0.0883024619, 0.2817188376, 0.6299787005),
    ),
    np.float32,
)
_TO_LAB = np.array(
    (
        (0.2104542553, 0.7936177850, -0.0040720468),
        (1.9779984951, -2.4285922050, 0.4505937099),
        (0.0259040371, 0.7827717662, -0.8086757660),
    ),
    np.float32,
)


@dataclass(frozen=True)
class ScanMaps:
    """values: [H, W, 8], kd, ks, r = sqrt(alpha) and height, the last in texels
    metal: [H, W], how much of a metal they are, 0 to 1
    wraps: whether it goes on at its other side, (down, across)
    has_height: whether anything told of its relief
    told: sentences about what was read and what was assumed
    """

    values: Array
    metal: Array
    wraps: Wraps
    has_height: bool
    name: str
    told: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[int, int]:
        return self.values.shape[0], self.values.shape[1]

    def crop(self, rows: slice, columns: slice) -> ScanMaps:
        """A part of it, which does not wrap where it was cut."""
        values = self.values[rows, columns]
        kept = tuple(
            wraps and new == old
            for wraps, new, old in zip(self.wraps, values.shape[:2], self.size, strict=True)
        )
        metal = self.metal[rows, columns]
        return replace(self, values=values, metal=metal, wraps=(kept[0], kept[1]))


def read_scan(path: Path) -> ScanMaps:
    """The scan at `path`: a folder of texture maps as `age` reads them, with displacement and
    normals where there are any, or one image, of which only the color is known then.

    Raises InputError where it cannot be read or has fewer than 32 texels a side.
    """
    if path.is_file() and path.suffix.lower() in EXTENSIONS:
        return _photo(path)
    material = read_input(path)
    if isinstance(material, MeasuredBRDF):
        raise InputError(
            f"{shown(path.name)} is one measured BRDF and shows no two states.",
            "Give a folder of texture maps.",
        )
    size = _size(material.size, path)
    values = _values(material, size)
    if isinstance(material, PrincipledMaps):
        metal = resize(material.metallic, size)
    else:
        metal = np.clip((values[..., 3:6].mean(-1) - 0.12) / 0.23, 0, 1)
    wraps = _wraps(values)
    relief = read_relief(path, size, wraps)
    if relief.height is not None:
        values[..., HEIGHT] = relief.height
    has_height, name = relief.height is not None, path.resolve().name
    return ScanMaps(values, metal, wraps, has_height, name, (relief.told,))


def _photo(path: Path) -> ScanMaps:
    color = read_image(path, color=True)
    color = resize(color, _size((color.shape[0], color.shape[1]), path))
    shape = color.shape[:2]

    def of(value: float) -> Array:
        return np.full(shape, value, np.float32)

    ones = np.ones_like(color)
    sockets = (color, of(0), of(0.5), of(_PHOTO_ROUGHNESS), of(1.5), ones)
    values = _values(PrincipledMaps(*sockets), (shape[0], shape[1]))
    told = (
        f"Only its color is known: a roughness of {_PHOTO_ROUGHNESS:g}, no metal and no relief were"
        " assumed."
    )
    return ScanMaps(values, of(0), _wraps(values), False, path.stem, (told,))


def _size(size: tuple[int, int], path: Path) -> tuple[int, int]:
    if min(size) < _LEAST:
        raise InputError(
            f"{shown(path.name)} has only {size[1]} x {size[0]} texels.",
            f"Give a scan of at least {_LEAST} texels a side.",
        )
    scale = min(1.0, LARGEST / max(size))
    return max(_LEAST, round(size[0] * scale)), max(_LEAST, round(size[1] * scale))


def _values(material: Maps, size: tuple[int, int]) -> Array:
    maps = forward(material) if isinstance(material, PrincipledMaps) else material
    maps = maps.map(lambda pixels: resize(pixels, size))
    values = np.zeros((*size, HEIGHT + 1), np.float32)
    values[..., :3], values[..., 3:6] = maps.kd, maps.ks
    values[..., ROUGHNESS] = np.sqrt(maps.alpha)
    return values


def _wraps(values: Array) -> Wraps:
    """Whether the first and the last row (column) differ no more than neighbors do."""
    found = []
    for axis in (0, 1):
        lines = np.moveaxis(values[..., :HEIGHT], axis, 0)
        usual = np.abs(lines[1:] - lines[:-1]).mean()
        found.append(bool(np.abs(lines[0] - lines[-1]).mean() <= _JUMP * usual + 1e-6))
    return found[0], found[1]


def features(maps: ScanMaps, *, sharp: bool = False) -> Array:
    """What tells kinds of surface apart, in steps that look about alike: lightness, twice
    chroma, roughness and metalness of a texel and, unless `sharp`, those around it, [H, W, 5].
    """
    values = maps.values
    color = np.maximum(values[..., :3] + values[..., 3:6], 0)
    lab = np.cbrt(color @ _TO_CONES.T) @ _TO_LAB.T
    lab[..., 1:] *= _CHROMA
    rest = (_ROUGH * values[..., ROUGHNESS], _METAL * maps.metal)
    told = np.concatenate((lab, np.stack(rest, -1)), -1)
    return told if sharp else smoothed(told, _SMOOTH, maps.wraps)
