"""What the report `realism` compares with: scans in two halves, one to learn from, one to meet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model_runtime.maps import PrincipledMaps
from model_runtime.reading.inputs import hash_input, read_input

from ...metric.texture import encoded
from ...source.quilting import quilted
from ...source.scan import Scan, read_states
from ...source.scan_maps import HEIGHT, ScanMaps, read_scan
from ..bench.kept import identity

__all__ = (
    "METALS",
    "RUST",
    "RUSTED",
    "SCANS",
    "Half",
    "HalvedScan",
    "Kind",
    "read_part",
    "scan_folder",
)

Array = NDArray[np.float32]

_CLEAN = -4.0  # texels from the border, of what is clean beyond doubt
_GONE = 3.0  # texels likewise, of what has weathered for good
_SEED = 16


@dataclass(frozen=True)
class Kind:
    """process: of the model that is learned; before: the bundled one of the last release that an
    artist would have taken; other: another scan of the kind.
    """

    process: str
    before: str
    other: str


SCANS: Mapping[str, Kind] = {
    "Metal022": Kind("rust", "rust", "rusty_metal_05"),
    "CorrugatedSteel007B": Kind("rust", "rust", "PaintedMetal007"),
    "PaintedMetal007": Kind("peeling", "rust", "CorrugatedSteel007B"),
    "wood_peeling_paint_weathered": Kind("peeling", "fading", "Planks010"),
    "Rock053": Kind("moss", "moss", "dirty_concrete"),
}
"""The scans that are learned from, by half."""

_NO_KIND = Kind("", "", "")

METALS = ("Metal032", "Metal024", "Metal035")
"""Clean metals of `pbr` that the bundled rust is put on."""

RUST = ("Rust004", "rusty_metal_05")
"""Scans of rust that it is compared with: no half of them is clean."""

RUSTED = (*RUST, "Metal022", "CorrugatedSteel007B", "PaintedMetal007")
"""All scans that show rust."""


def scan_folder(data: Path, name: str) -> Path:
    """Where the maps of a scan are."""
    scans = data / "scans" / name
    return scans if scans.is_dir() and len(list(scans.iterdir())) > 1 else data / "pbr" / name


def read_part(folder: Path, size: int) -> PrincipledMaps:
    """The upper left `size` x `size` texels of the maps in `folder`."""
    maps = read_input(folder)
    assert isinstance(maps, PrincipledMaps)
    return maps.map(lambda pixels: pixels[:size, :size])


@dataclass(frozen=True)
class Half:
    """Base color [H, W, 3] (sRGB), how far inside the weathered part each texel lies [H, W]
    (texels, negative outside), and height [H, W] (texels).
    """

    picture: Array
    depth: Array
    height: Array


@dataclass(frozen=True)
class HalvedScan:
    """A scan, or a square part of it, cut down its middle."""

    name: str
    folder: Path
    kind: Kind
    scan: Scan
    maps: PrincipledMaps

    @classmethod
    def read(cls, data: Path, name: str, size: int) -> HalvedScan:
        """The scan `name` of the data folder; InputError where it shows no two states."""
        folder, kind = scan_folder(data, name), SCANS.get(name, _NO_KIND)
        part = (slice(0, size), slice(0, size))
        scan = read_states(read_scan(folder).crop(*part), process=kind.process)
        return cls(name, folder, kind, scan, read_part(folder, size))

    def weathered(self, half: Half) -> Array:
        """A picture [S, S, 3] (sRGB) that wraps, half as wide as the scan, quilted of what is
        weathered in one of its halves.
        """
        middle = self.maps.size[1] // 2
        inside = half.depth > _GONE
        usable = inside if inside.any() else half.depth > 0
        return quilted(half.picture, usable, (False, False), middle, _SEED).clip(0, 1)

    @property
    def made_from(self) -> str:
        """What identifies it."""
        return identity(str(hash_input(self.folder)), str(self.kind), str(self.maps.size))

    @property
    def source(self) -> ScanMaps:
        """The left half, to learn from."""
        height, width = self.scan.maps.size
        return self.scan.maps.crop(slice(0, height), slice(0, width // 2))

    @cached_property
    def left(self) -> Half:
        """What is learned from."""
        return self._half(slice(0, self.maps.size[1] // 2))

    @cached_property
    def right(self) -> Half:
        """What is to be met."""
        return self._half(slice(self.maps.size[1] // 2, None))

    def _half(self, columns: slice) -> Half:
        height = self.scan.maps.values[:, columns, HEIGHT]
        picture = encoded(np.ascontiguousarray(self.maps.base_color[:, columns]))
        return Half(picture, self.scan.distance[:, columns], height)

    @cached_property
    def mean_weathered(self) -> Array:
        """The mean base color [3], linear, of what is weathered in the left half."""
        middle = self.maps.size[1] // 2
        return self.maps.base_color[:, :middle][self.left.depth > 0].mean(0)

    @cached_property
    def clean(self) -> PrincipledMaps:
        """A material that wraps, as large as the scan, of what is clean in the left half; every
        texel of it is there four times.
        """
        middle = self.maps.size[1] // 2
        maps = self.maps.map(lambda pixels: pixels[:, :middle])
        channels = (maps.metallic, maps.roughness)
        values = np.concatenate((maps.base_color, np.stack(channels, -1)), -1)
        clean = self.left.depth < _CLEAN
        if not clean.any():
            clean = self.left.depth < 0
        tile = quilted(values, clean, (False, False), middle, _SEED).clip(0, 1)
        tile = np.tile(tile, (2, 2, 1))
        size = tile.shape[:2]

        def whole(pixels: Array) -> Array:
            return np.broadcast_to(pixels[0, 0], size + pixels.shape[2:])

        return replace(
            maps.map(whole), base_color=tile[..., :3], metallic=tile[..., 3], roughness=tile[..., 4]
        )
