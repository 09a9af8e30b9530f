"""Images in and out: JPEG, PNG, TIFF and EXR to float32 arrays, and arrays to half-float EXR.

Row 0 is the top row; colours are linear Rec.709. Nothing here keeps state, so threads may read
and write side by side; but OpenEXR holds the interpreter while it codes, so they gain little.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenEXR
import torch
from PIL import Image, ImageFile, UnidentifiedImageError

from .atomic import replaced
from .errors import InputError, OutputError, reason, shown
from .maps import HALF_MAX, Halves, Pixels
from .memory import ran_out_of_memory

__all__ = ("EXTENSIONS", "MAX_SIDE", "Compression", "Depth", "read_image", "resize", "write_exr")

MAX_SIDE = 16384
# Pillow's own limit is lower than ours, and speaks of bombs; sizes are checked here instead.
Image.MAX_IMAGE_PIXELS = None

_PILLOW = {".jpg": "JPEG", ".jpeg": "JPEG", ".png": "PNG", ".tif": "TIFF", ".tiff": "TIFF"}
EXTENSIONS = (*_PILLOW, ".exr")
"""What `read_image` reads, in the order in which duplicates are preferred."""

_FORMATS = tuple(sorted(set(_PILLOW.values())))
_NATIVE_OTHER = "16B" if sys.byteorder == "little" else "16L"
_OTHER_BYTES = {
    f"{mode};{order}": f"{mode};{other}"
    for mode in ("RGB", "RGBA")
    for order, other in (("16B", "16L"), ("16L", "16B"), ("16N", _NATIVE_OTHER))
}

_HINT = "Save it again as JPEG, PNG, TIFF or OpenEXR."
_LARGEST_BLOCK = 1 << 29
_LINES = {
    **dict.fromkeys((OpenEXR.NO_COMPRESSION, OpenEXR.RLE_COMPRESSION, OpenEXR.ZIPS_COMPRESSION), 1),
    **dict.fromkeys((OpenEXR.ZIP_COMPRESSION, OpenEXR.PXR24_COMPRESSION), 16),
    **dict.fromkeys((OpenEXR.PIZ_COMPRESSION, OpenEXR.DWAA_COMPRESSION), 32),
}
"""Lines of a block by compression; of others at most 256."""

_EXR_TYPES = {"HALF": np.float16, "FLOAT": np.float32, "UINT": np.uint32}
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)

Compression = Literal["none", "zip"]
Depth = Literal["half", "single"]
# Measured with the four maps of 12 aged materials, 1024 x 1024, on one busy core: ZIP is written in
# 113 ms, read in 32 and takes 6.4 MB; PIZ 147, 45 and 6.5 MB; RLE 42, 29 and 9.0 MB; none 17, 11
# and 12.6 MB. Newer ways (ZSTD, HTJ2K) cannot be read by Blender 4.2.
_COMPRESSIONS = {"none": OpenEXR.NO_COMPRESSION, "zip": OpenEXR.ZIP_COMPRESSION}


def read_image(path: str | Path, *, color: bool) -> Pixels:
    """Read an image file as [H, W, 3] linear colour or, where not `color`, as [H, W] data.

    Integer formats are scaled to 0..1, and colour is decoded from sRGB; floats are taken as they
    are. Alpha is dropped, grey is repeated as colour, and coloured data count by their luminance,
    as in Blender. Raises InputError where the file is missing, damaged, of another format or has
    more than 16384 pixels a side.
    """
    pixels = _read(Path(path), decode=color)
    if color:
        return pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, -1)
    return pixels if pixels.ndim == 2 else _luminance(pixels)


def read_packed(path: str | Path) -> Pixels:
    """Read an image whose channels are maps of their own, as data: [H, W, 3].

    Raises InputError as `read_image` does, and for an image of one channel.
    """
    pixels = _read(Path(path), decode=False)
    if pixels.ndim == 2:
        raise InputError(f"{shown(Path(path).name)} has one channel, not three packed maps.", _HINT)
    return pixels


def _read(path: Path, *, decode: bool) -> Pixels:
    """[H, W] or [H, W, 3] of the file at `path`, integers decoded from sRGB where asked."""
    extension, file = path.suffix.lower(), shown(path.name)
    if extension not in EXTENSIONS:
        raise InputError(f"{file} is not in an image format that can be read.", _HINT)
    try:
        if not path.is_file():
            raise InputError(f"{shown(path)} is not a file.", "Check the path.")
        with path.open("rb"):
            pass
    except (OSError, ValueError) as error:
        raise InputError(f"{file} cannot be opened: {reason(error)}.", "Check the path.") from error
    try:
        with _quiet():
            return _read_exr(path) if extension == ".exr" else _read_integer(path, decode=decode)
    except InputError:
        raise
    except Exception as error:  # the decoders raise whatever a damaged file makes them
        if ran_out_of_memory(error):
            raise
        why = "" if isinstance(error, UnidentifiedImageError) else f": {reason(error)}"
        raise InputError(f"{file} is damaged or not an image{why}.", _HINT) from error


def write_exr(
    path: str | Path,
    pixels: Pixels | Halves,
    *,
    compression: Compression = "zip",
    depth: Depth = "half",
) -> None:
    """Write [H, W] as channel Y or [H, W, 3] as R, G, B: floats of this `depth`, lossless.

    The file appears whole or not at all: it is written beside and renamed. Values beyond the range
    of half floats (65504) are clamped to it. Raises OutputError where the file cannot be written,
    or would hold what is no finite number.
    """
    assert pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 3), pixels.shape
    planes = [pixels] if pixels.ndim == 2 else np.moveaxis(pixels, -1, 0)
    names = "Y" if pixels.ndim == 2 else "RGB"
    stored = _half if depth == "half" else np.ascontiguousarray
    channels = {name: stored(plane) for name, plane in zip(names, planes, strict=True)}
    header = {"compression": _COMPRESSIONS[compression], "type": OpenEXR.scanlineimage}
    if not all(_is_finite(plane) for plane in channels.values()):
        raise OutputError(
            f"{shown(Path(path).name)} would hold texels that are not numbers.",
            "Either the model file or a map of the material is to blame: try a bundled model.",
        )
    content = io.BytesIO()
    OpenEXR.File(header, channels, num_threads=0).write(content)
    with replaced(Path(path)) as beside:
        beside.write_bytes(content.getbuffer())


def _half(plane: Pixels | Halves) -> Halves:
    # torch rounds to half floats six times as fast as numpy, and to the same ones.
    whole = torch.from_numpy(np.require(plane, requirements=("C", "W")))
    return whole.half().clamp(-HALF_MAX, HALF_MAX).numpy()


def _is_finite(plane: np.ndarray) -> bool:
    if plane.dtype != np.float16:
        return bool(np.isfinite(plane).all())
    # By their bits: a tenth of the time that numpy takes with halves.
    return bool((plane.view(np.uint16) & 0x7FFF).max() < 0x7C00)


def resize(pixels: Pixels, size: tuple[int, int]) -> Pixels:
    """Resample [H, W] or [H, W, C] to `size` = (height, width).

    Along an axis that shrinks, each new texel is the average of the area it covers; along one that
    grows, linear interpolation between texel centres, edges repeated.
    """
    for axis, length in enumerate(size):
        pixels = _resize_axis(pixels, axis, length)
    return np.ascontiguousarray(pixels)


def _resize_axis(pixels: Pixels, axis: int, length: int) -> Pixels:
    old = pixels.shape[axis]
    if length == old:
        return pixels
    index, weight = _area(old, length) if length < old else _linear(old, length)
    broadcast = [1] * pixels.ndim
    broadcast[axis] = length
    total = np.zeros((*pixels.shape[:axis], length, *pixels.shape[axis + 1 :]), np.float32)
    for sources, shares in zip(index, weight, strict=True):
        total += pixels.take(sources, axis) * shares.reshape(broadcast).astype(np.float32)
    return total


def _area(old: int, new: int) -> tuple[np.ndarray, np.ndarray]:
    """Source texels and their shares, each [taps, new], of an average over old / new texels."""
    edges = np.arange(new + 1) * old / new
    first = np.floor(edges[:-1] + 1e-9).astype(int)
    index = first + np.arange(int(np.ceil(old / new)) + 1)[:, None]
    overlap = np.minimum(index + 1, edges[1:]) - np.maximum(index, edges[:-1])
    weight = overlap.clip(0) * new / old
    used = weight.max(1) > 1e-9
    return index.clip(0, old - 1)[used], weight[used]


def _linear(old: int, new: int) -> tuple[np.ndarray, np.ndarray]:
    """Source texels and their shares, each [2, new], of linear interpolation."""
    place = ((np.arange(new) + 0.5) * old / new - 0.5).clip(0, old - 1)
    lower = np.floor(place).astype(int)
    fraction = place - lower
    return np.stack((lower, (lower + 1).clip(max=old - 1))), np.stack((1 - fraction, fraction))


def _luminance(pixels: Pixels) -> Pixels:
    if np.array_equal(pixels[..., 0], pixels[..., 1]) and np.array_equal(
        pixels[..., 0], pixels[..., 2]
    ):
        return np.ascontiguousarray(pixels[..., 0])  # exact, where the weighted sum would round
    return pixels @ _LUMINANCE


def _check_size(path: Path, width: int, height: int) -> None:
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise InputError(
            f"{shown(path.name)} has {width} x {height} pixels.",
            f"Resize it to {MAX_SIDE} a side or less.",
        )


def _read_integer(path: Path, *, decode: bool) -> Pixels:
    """[H, W] or [H, W, 3] of a JPEG, PNG or TIFF."""
    codes = _codes(path)
    if codes.dtype == np.float32:
        return codes
    most = np.iinfo(codes.dtype).max
    levels = np.arange(most + 1, dtype=np.float32) / np.float32(most)
    return (_decode_srgb(levels) if decode else levels)[codes]


def _codes(path: Path) -> np.ndarray:
    """Stored values as uint8, uint16 or float32, [H, W] or [H, W, 3], without alpha."""
    with Image.open(path, formats=_FORMATS) as image:
        _check_size(path, *image.size)
        image.info.pop("transparency", None)
        raw_mode = _raw_mode(image)
        if image.mode == "F":
            return np.asarray(image, np.float32)
        if image.mode.startswith("I"):
            wide = np.asarray(image)
            if wide.min() < 0 or wide.max() > 65535:
                raise ValueError("integers of more than 16 bits")
            return wide.astype(np.uint16)
        grey = image.mode in ("1", "L", "LA")
        high = np.asarray(image.convert("L" if grey else "RGB"))
    if raw_mode not in _OTHER_BYTES:
        return high
    # Of 16-bit colour Pillow keeps the high bytes only, unless its decoder is told that the file
    # has the other byte order: then it keeps the low ones.
    with Image.open(path, formats=_FORMATS) as image:
        image.tile = [tile._replace(args=_renamed(tile.args, raw_mode)) for tile in image.tile]
        low = np.asarray(image.convert("RGB"))
    return high.astype(np.uint16) << 8 | low


def _raw_mode(image: ImageFile.ImageFile) -> str:
    """How the file stores a pixel, as Pillow's decoders name it."""
    args = image.tile[0].args if image.tile else ""
    return args if isinstance(args, str) else str(args[0]) if args else ""


def _renamed(args: object, raw_mode: str) -> object:
    other = _OTHER_BYTES[raw_mode]
    return other if isinstance(args, str) else (other, *args[1:])  # type: ignore[index]


def _decode_srgb(code: Pixels) -> Pixels:
    """IEC 61966-2-1, 0..1 to linear 0..1."""
    curve = ((code.astype(np.float64) + 0.055) / 1.055) ** 2.4
    return np.where(code <= 0.04045, code / 12.92, curve).astype(np.float32)


def _read_exr(path: Path) -> Pixels:
    """[H, W] or [H, W, 3] of the first part's colour, luminance or only channel."""
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


def _what_to_read(path: Path, header: dict[str, Any]) -> tuple[list[str], tuple[int, int]]:
    """The channels to read of a file with this header, and their height and width."""
    file, channels = shown(path.name), {each.name: each for each in header["channels"]}
    if header["type"] in (OpenEXR.deepscanline, OpenEXR.deeptile):
        raise InputError(
            f"{file} holds deep data, many samples to a pixel.", "Flatten it to a plain image."
        )
    low, high = header["dataWindow"]
    width, height = (int(b) - int(a) + 1 for a, b in zip(low, high, strict=True))
    _check_size(path, width, height)
    names = _choose_channels(list(channels))
    if any(
        (channels[name].xSampling, channels[name].ySampling) != (1, 1) for name in names or channels
    ):
        raise InputError(f"{file} holds subsampled channels.", "Save it as plain R, G and B.")
    if not names:
        raise InputError(f"{file} holds several channels and none of them is R, G, B or Y.", _HINT)
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


_ONE_AT_A_TIME = threading.Lock()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Nothing on stderr: OpenEXR and libtiff complain there of damaged files, past all that Python
    can catch, and Pillow warns of what it forgives. Where it matters they raise an error as well.
    """
    with _ONE_AT_A_TIME, warnings.catch_warnings(action="ignore"):
        try:
            spoken = os.dup(2)
        except OSError:  # there is no stderr
            yield
            return
        nothing = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nothing, 2)
            yield
        finally:
            os.dup2(spoken, 2)
            os.close(nothing)
            os.close(spoken)


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
