"""Reads OpenEXR files, whatever is in them: the channels that are wanted, and no more memory."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from .errors import InputError, shown
from .maps import Pixels

__all__ = ("MAX_SIDE", "RESAVE", "check_size", "read_exr", "read_exr_vectors")

MAX_SIDE = 16384
RESAVE = "Save it again as JPEG, PNG, TIFF or OpenEXR."
_LARGEST_BLOCK = 1 << 29
_LINES = {
    **dict.fromkeys((OpenEXR.NO_COMPRESSION, OpenEXR.RLE_COMPRESSION, OpenEXR.ZIPS_COMPRESSION), 1),
    **dict.fromkeys((OpenEXR.ZIP_COMPRESSION, OpenEXR.PXR24_COMPRESSION), 16),
    **dict.fromkeys((OpenEXR.PIZ_COMPRESSION, OpenEXR.DWAA_COMPRESSION), 32),
}
"""Lines of a block by compression; of others at most 256."""

_STRIPE = 256  # lines that are read at a time where not all are kept
_EXR_TYPES = {"HALF": np.float16, "FLOAT": np.float32, "UINT": np.uint32}


def check_size(path: Path, width: int, height: int) -> None:
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise InputError(
            f"{shown(path.name)} has {width} x {height} pixels.",
            f"Resize it to {MAX_SIDE} a side or less.",
        )


def read_exr(path: Path) -> Pixels:
    """[H, W] or [H, W, 3] of the first part's color, luminance or only channel."""
    with path.open("rb") as stream:  # paths themselves must be UTF-8 for OpenEXR
        header = OpenEXR.File(stream, header_only=True).header()
        names, (height, width) = _what_to_read(path, header)
        stream.seek(0)
        # The newer OpenEXR.File reads every channel of every part, however many there are.
        with contextlib.closing(OpenEXR.InputFile(stream)) as file:
            stored = file.header()["channels"]
            types = [_EXR_TYPES[str(stored[name].type)] for name in names]
            contents = file.channels(names)
    planes = [
        np.frombuffer(content, dtype).reshape(height, width)
        for content, dtype in zip(contents, types, strict=True)
    ]
    return (
        planes[0].astype(np.float32) if len(planes) == 1 else np.stack(planes, -1, dtype=np.float32)
    )


def read_exr_vectors(path: Path, most: int) -> Pixels:
    """[H, W, 4] of the first part, a stripe at a time."""
    with path.open("rb") as stream:
        header = OpenEXR.File(stream, header_only=True).header()
        names, (height, width) = _what_to_read(path, header)
        if len(names) != 3:
            raise InputError(f"{shown(path.name)} has one channel, not three.", RESAVE)
        alpha = f"{names[0][:-1]}{'a' if names[0][-1].islower() else 'A'}"
        stream.seek(0)
        with contextlib.closing(OpenEXR.InputFile(stream)) as file:
            stored = file.header()["channels"]
            names = [*names, alpha] if alpha in stored else names
            types = [_EXR_TYPES[str(stored[name].type)] for name in names]
            top = int(header["dataWindow"][0][1])
            step = -(-max(height, width) // most)
            rows, columns = (np.arange(step // 2, side, step) for side in (height, width))
            pixels = np.ones((len(rows), len(columns), 4), np.float32)
            for first in range(0, height, _STRIPE):
                last = min(first + _STRIPE, height) - 1
                kept = (rows >= first) & (rows <= last)
                stripe = file.channels(names, scanLine1=top + first, scanLine2=top + last)
                for channel, (content, dtype) in enumerate(zip(stripe, types, strict=True)):
                    plane = np.frombuffer(content, dtype).reshape(-1, width)
                    pixels[kept, :, channel] = plane[np.ix_(rows[kept] - first, columns)]
    return pixels


def _what_to_read(path: Path, header: dict[str, Any]) -> tuple[list[str], tuple[int, int]]:
    """The channels to read of a file with this header, and their height and width."""
    file, channels = shown(path.name), {each.name: each for each in header["channels"]}
    if header["type"] in (OpenEXR.deepscanline, OpenEXR.deeptile):
        raise InputError(
            f"{file} holds deep data, many samples to a pixel.", "Flatten it to a plain image."
        )
    low, high = header["dataWindow"]
    width, height = (int(b) - int(a) + 1 for a, b in zip(low, high, strict=True))
    check_size(path, width, height)
    names = _choose_channels(list(channels))
    if any(
        (channels[name].xSampling, channels[name].ySampling) != (1, 1) for name in names or channels
    ):
        raise InputError(f"{file} holds subsampled channels.", "Save it as plain R, G and B.")
    if not names:
        raise InputError(f"{file} holds several channels and none of them is R, G, B or Y.", RESAVE)
    # A block is decoded whole, hidden channels and all.
    tile = header.get("tiles")
    lines = _LINES.get(header["compression"], 256)
    texels = tile.xSize * tile.ySize if tile else width * lines
    if texels * len(channels) * 4 > _LARGEST_BLOCK:
        raise InputError(
            f"{file} holds {len(channels)} channels in blocks too large to be read.",
            "Save R, G and B alone.",
        )
    return names, (height, width)


def _choose_channels(names: list[str]) -> list[str]:
    """R, G, B of the first layer that has all three, else Y, else the only channel but alpha."""
    for red in names:
        layer, _, last = red.rpartition(".")
        prefix = f"{layer}." if layer else ""
        for letters in ("RGB", "rgb"):
            rgb = [prefix + letter for letter in letters]
            if last == letters[0] and set(rgb) <= set(names):
                return rgb
    opaque = [name for name in names if name.rpartition(".")[2].upper() != "A"]
    luminance = [name for name in opaque if name.rpartition(".")[2].upper() == "Y"]
    if len(luminance) == 1 and len(opaque) == 1:
        return luminance
    return opaque if len(opaque) == 1 else []
