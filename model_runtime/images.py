"""Images in and out: JPEG, PNG, TIFF and EXR to float32 arrays, and arrays to EXR and PNG.

Row 0 is the top row; colors are linear Rec.709. Nothing here keeps state, so threads may read
and write side by side; but OpenEXR holds the interpreter while it codes, so they gain little.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import threading
import warnings
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

import numpy as np
import OpenEXR
from PIL import Image, ImageFile, UnidentifiedImageError

from .atomic import replaced
from .backend import torch
from .errors import InputError, OutputError, reason, shown
from .exr import MAX_SIDE, RESAVE, check_size, read_exr, read_exr_vectors
from .maps import HALF_MAX, Bytes, Halves, Pixels
from .memory import ran_out_of_memory

__all__ = (
    "EXTENSIONS",
    "MAX_SIDE",
    "Compression",
    "Depth",
    "read_bytes",
    "read_image",
    "read_vectors",
    "write_exr",
    "write_png",
)

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

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)

Compression = Literal["none", "zip"]
Depth = Literal["half", "single"]
# Measured with the four maps of 12 aged materials, 1024 x 1024, on one busy core: ZIP is written in
# 113 ms, read in 32 and takes 6.4 MB; PIZ 147, 45 and 6.5 MB; RLE 42, 29 and 9.0 MB; none 17, 11
# and 12.6 MB. Newer ways (ZSTD, HTJ2K) cannot be read by Blender 4.2.
_COMPRESSIONS = {"none": OpenEXR.NO_COMPRESSION, "zip": OpenEXR.ZIP_COMPRESSION}


def read_image(path: str | Path, *, color: bool) -> Pixels:
    """Read an image file as [H, W, 3] linear color or, where not `color`, as [H, W] data.

    Integer formats are scaled to 0..1, and color is decoded from sRGB; floats are taken as they
    are. Alpha is dropped, gray is repeated as color, and colored data count by their luminance,
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
        raise InputError(
            f"{shown(Path(path).name)} has one channel, not three packed maps.", RESAVE
        )
    return pixels


def read_vectors(path: str | Path, *, most: int) -> Pixels:
    """Read R, G, B and alpha of an OpenEXR file as they are stored, with 1 where there is no alpha:
    [H, W, 4] of every so many texels, the fewest for which no side has more than `most`.

    Raises InputError as `read_image` does, and for what has no three channels.
    """
    return _read_with(lambda file: read_exr_vectors(file, most), Path(path), (".exr",))


def _read(path: Path, *, decode: bool) -> Pixels:
    """[H, W] or [H, W, 3] of the file at `path`, integers decoded from sRGB where asked."""

    def read(path: Path) -> Pixels:
        return (
            read_exr(path) if path.suffix.lower() == ".exr" else _read_integer(path, decode=decode)
        )

    return _read_with(read, path, EXTENSIONS)


def _read_with(read: Callable[[Path], Pixels], path: Path, extensions: tuple[str, ...]) -> Pixels:
    """What `read` makes of the file at `path`, with a sentence for all that can go wrong."""
    extension, file = path.suffix.lower(), shown(path.name)
    if extension not in extensions:
        raise InputError(f"{file} is not in an image format that can be read.", RESAVE)
    try:
        if not path.is_file():
            raise InputError(f"{shown(path)} is not a file.", "Check the path.")
        with path.open("rb"):
            pass
    except (OSError, ValueError) as error:
        raise InputError(f"{file} cannot be opened: {reason(error)}.", "Check the path.") from error
    try:
        with _quiet():
            return read(path)
    except InputError:
        raise
    except Exception as error:  # the decoders raise whatever a damaged file makes them
        if ran_out_of_memory(error):
            raise
        why = "" if isinstance(error, UnidentifiedImageError) else f": {reason(error)}"
        raise InputError(f"{file} is damaged or not an image{why}.", RESAVE) from error


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


def write_png(path: str | Path, pixels: Bytes) -> None:
    """Write [H, W, 3 or 4], the fourth channel as alpha; whole or not at all."""
    content = io.BytesIO()
    # Measured with 1024 x 1024 texels of four noises: 100 ms and 3.9 MB; what takes longer finds
    # no more that repeats.
    Image.fromarray(np.ascontiguousarray(pixels)).save(
        content, "PNG", compress_level=1, compress_type=zlib.Z_RLE
    )
    with replaced(Path(path)) as beside:
        beside.write_bytes(content.getbuffer())


def read_bytes(path: str | Path) -> Pixels:
    """What `write_png` wrote, as [H, W, 3 or 4] from 0 to 1."""

    def read(path: Path) -> Pixels:
        with Image.open(path, formats=["PNG"]) as image:
            return np.asarray(image, np.float32) / 255

    return _read_with(read, Path(path), (".png",))


def _half(plane: Pixels | Halves) -> Halves:
    # torch rounds to half floats six times as fast as numpy, and to the same ones.
    whole = torch.from_numpy(np.require(plane, requirements=("C", "W")))
    return whole.half().clamp(-HALF_MAX, HALF_MAX).numpy()


def _is_finite(plane: np.ndarray) -> bool:
    if plane.dtype != np.float16:
        return bool(np.isfinite(plane).all())
    # By their bits: a tenth of the time that numpy takes with halves.
    return bool((plane.view(np.uint16) & 0x7FFF).max() < 0x7C00)


def _luminance(pixels: Pixels) -> Pixels:
    if np.array_equal(pixels[..., 0], pixels[..., 1]) and np.array_equal(
        pixels[..., 0], pixels[..., 2]
    ):
        return np.ascontiguousarray(pixels[..., 0])  # exact, where the weighted sum would round
    return pixels @ _LUMINANCE


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
        check_size(path, *image.size)
        image.info.pop("transparency", None)
        raw_mode = _raw_mode(image)
        if image.mode == "F":
            return np.asarray(image, np.float32)
        if image.mode.startswith("I"):
            wide = np.asarray(image)
            if wide.min() < 0 or wide.max() > 65535:
                raise ValueError("integers of more than 16 bits")
            return wide.astype(np.uint16)
        gray = image.mode in ("1", "L", "LA")
        high = np.asarray(image.convert("L" if gray else "RGB"))
    if raw_mode not in _OTHER_BYTES:
        return high
    # Of 16-bit color Pillow keeps the high bytes only, unless its decoder is told that the file
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
