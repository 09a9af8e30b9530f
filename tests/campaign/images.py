"""Images of every sort, honest and damaged, as maps of a material and as onset images."""

from __future__ import annotations

import io
import os
import random
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image

from .damage import damaged
from .evidence import Evidence
from .trial import Trial

__all__ = ("attempt_map", "attempt_onset", "picture")

_MODES = ("1", "L", "LA", "P", "RGB", "RGBA", "CMYK", "YCbCr", "LAB", "I", "I;16", "F")
_SPECIALS = (float("nan"), float("inf"), -float("inf"), -1.0, 1e30, 3e38, 65504.0, 1e-45, 100.0)
_SIDES = (1, 2, 7, 8, 16, 33)
# A picture of 16,384 pixels a side may be read, and takes its memory.
_HUGE = (0, 1, 16385, 65535, 100_000, 2**31 - 1, 2**32 - 1)


def attempt_map(trial: Trial) -> list[Evidence]:
    """One map of a material replaced by any picture."""
    rng = trial.rng
    if rng.random() < 0.3:
        return _attempt_torrance_sparrow(trial)
    folder = trial.textures()
    stem = rng.choice(("M_Color", "M_Roughness", "M_Metalness", "M_arm", "M_Gloss", "M_ior"))
    extension, content = picture(trial)
    for path in folder.glob(f"{stem}.*"):
        path.unlink()
    (folder / f"{stem}{extension}").write_bytes(content)
    request = trial.request(
        specular=rng.choice(("rgb", "mono")),
        format=rng.choice((None, None, "torrance-sparrow", "principled", "principled-exact")),
        sparse=rng.random() < 0.2,
        size=rng.choice((None, None, 4, 8, 20)),
    )
    return [trial.age(request)]


def _attempt_torrance_sparrow(trial: Trial) -> list[Evidence]:
    folder = trial.folder / "in"
    for path in trial.samples.torrance_sparrow.iterdir():
        folder.mkdir(exist_ok=True)
        (folder / path.name).write_bytes(path.read_bytes())
    name = trial.rng.choice(("kd", "ks", "alpha"))
    (folder / f"{name}.exr").write_bytes(_maybe_damaged(_exr(trial), trial.rng))
    wanted = trial.rng.choice((None, "principled", "principled-exact"))
    return [trial.age(trial.request(format=wanted))]


def attempt_onset(trial: Trial) -> list[Evidence]:
    """Any picture, or what is none, as the onset image."""
    rng = trial.rng
    trial.textures()
    extension, content = picture(trial)
    path = trial.folder / f"onset{extension}"
    match rng.randrange(12):
        case 0:
            path.mkdir()
        case 1:
            os.mkfifo(path)
        case 2:
            path.symlink_to(rng.choice((path, "/dev/zero", "absent", trial.folder / "in")))
        case 3:
            path = Path(
                rng.choice(("", " ", "http://x/y.png", "auto ", "NONE", "x\0.png", "\ud800"))
            )
        case _:
            path.write_bytes(content)
    return [trial.age(trial.request(onset=str(path), size=rng.choice((None, 4, 40))))]


def picture(trial: Trial) -> tuple[str, bytes]:
    """An ending and a content, which fit together more often than not."""
    rng = trial.rng
    make = rng.choice((_png, _png, _jpeg, _tiff, _tiff, _exr, _exr, _exr, _other))
    content = _maybe_damaged(make(trial), rng)
    extension = {_png: ".png", _jpeg: ".jpg", _tiff: ".tif"}.get(make, ".exr")
    if rng.random() < 0.05:
        extension = rng.choice((".png", ".jpeg", ".tiff", ".exr", ".EXR", ".Png"))
    return extension, content


def _maybe_damaged(content: bytes, rng: random.Random) -> bytes:
    luck = rng.random()
    return damaged(content, rng) if luck < 0.5 else _lying(content, rng) if luck < 0.7 else content


def _image(trial: Trial, modes: tuple[str, ...]) -> Image.Image:
    rng = trial.rng
    height, width = rng.choice(((8, 8), (8, 8), (rng.choice(_SIDES), rng.choice(_SIDES))))
    mode = rng.choice(modes)
    if mode == "F":
        plane = trial.numpy_rng.random((height, width)).astype(np.float32)
        plane.flat[rng.randrange(plane.size)] = rng.choice((*_SPECIALS, 0.5))
        return Image.fromarray(plane)
    if mode in ("I", "I;16"):
        most = rng.choice((255, 65535, 2**31 - 1)) if mode == "I" else 65535
        plane = trial.numpy_rng.integers(0, most, (height, width))
        return Image.fromarray(plane.astype(np.int32 if mode == "I" else np.uint16))
    codes = trial.numpy_rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    return Image.fromarray(codes).convert(mode) if mode != "LAB" else Image.fromarray(codes, "LAB")


def _saved(image: Image.Image, kind: str, **options: object) -> bytes:
    content = io.BytesIO()
    image.save(content, kind, **options)
    return content.getvalue()


def _png(trial: Trial) -> bytes:
    content = _saved(_image(trial, ("1", "L", "LA", "P", "RGB", "RGBA", "I;16")), "PNG")
    extra = {
        "text": _chunk(b"tEXt", b"Comment\0" + b"x" * 1_000_000),
        "bomb": _chunk(b"zTXt", b"Comment\0\0" + zlib.compress(b"x" * 100_000_000)),
        "profile": _chunk(b"iCCP", b"x\0\0" + zlib.compress(b"\0" * 10_000_000)),
        "gamma": _chunk(b"gAMA", struct.pack(">I", 0)),
        "animation": _chunk(b"acTL", struct.pack(">II", 2**31, 0)),
    }
    if trial.rng.random() < 0.15:
        return content[:33] + trial.rng.choice(list(extra.values())) + content[33:]
    return content


def _jpeg(trial: Trial) -> bytes:
    image = _image(trial, ("L", "RGB", "CMYK", "YCbCr"))
    return _saved(image, "JPEG", progressive=trial.rng.random() < 0.3)


def _tiff(trial: Trial) -> bytes:
    compression = trial.rng.choice((None, "tiff_lzw", "tiff_adobe_deflate", "packbits"))
    image = _image(trial, tuple(mode for mode in _MODES if mode != "LAB"))
    pages = [image] * trial.rng.choice((0, 0, 3))
    return _saved(image, "TIFF", compression=compression, save_all=bool(pages), append_images=pages)


def _other(trial: Trial) -> bytes:
    """A file of another format, or of none."""
    kind = trial.rng.choice(("GIF", "BMP", "PPM", "WEBP", "TGA", "text", "random", "nothing"))
    plain = {"text": b"<html>not found</html>", "nothing": b"", "random": trial.rng.randbytes(999)}
    return plain[kind] if kind in plain else _saved(_image(trial, ("RGB",)), kind)


def _exr(trial: Trial) -> bytes:
    return trial.rng.choice(_EXRS)(trial)


def _plane(trial: Trial, height: int = 8, width: int = 8) -> np.ndarray:
    """Random values in a random number format, some of them special."""
    rng = trial.rng
    plane = trial.numpy_rng.random((height, width)).astype(np.float32)
    if rng.random() < 0.4:
        plane.flat[rng.randrange(plane.size)] = rng.choice(_SPECIALS)
    if rng.random() < 0.05:
        plane[:] = rng.choice(_SPECIALS)
    with np.errstate(all="ignore"):
        return plane.astype(rng.choice((np.float32, np.float32, np.float16, np.uint32)))


def _plain_exr(trial: Trial) -> bytes:
    height, width = trial.rng.choice(((8, 8), (8, 8), (1, 1), (16, 8), (3, 40)))
    names = trial.rng.choice(_CHANNELS)
    return _written({}, {name: _plane(trial, height, width) for name in names})


def _windowed_exr(trial: Trial) -> bytes:
    """Data and display windows that differ, or begin elsewhere."""
    low = trial.rng.choice((0, -8, 5, -(2**20), 2**20))
    window = (np.array([low, low], np.int32), np.array([low + 7, low + 7], np.int32))
    display = (np.array([0, 0], np.int32), np.array([99, 99], np.int32))
    header = {"dataWindow": window, "displayWindow": trial.rng.choice((window, display))}
    return _written(header, {name: _plane(trial) for name in "RGB"})


def _many_exr(trial: Trial) -> bytes:
    """Many channels, and many or long attributes."""
    count = trial.rng.choice((30, 300))
    header = {f"note{k}": "x" * trial.rng.choice((1, 10_000)) for k in range(20)}
    channels = {name: _plane(trial) for name in "RGB"}
    return _written(header, channels | {f"a.b{k}": _plane(trial) for k in range(count)})


def _deep_exr(trial: Trial) -> bytes:
    samples = np.empty((8, 8), dtype=object)
    for place in np.ndindex(8, 8):
        samples[place] = np.ones(trial.rng.choice((0, 1, 3)), np.float32)
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    return _written(header, {name: samples.copy() for name in "RGB"})


def _parts_exr(trial: Trial) -> bytes:
    """Several parts; the honest color is in any of them."""
    if trial.rng.random() < 0.1:
        return trial.samples.hidden_giant
    plain = {"type": OpenEXR.scanlineimage}
    parts = []
    for k, names in enumerate(trial.rng.choices(_CHANNELS, k=trial.rng.choice((2, 3, 12)))):
        channels = {name: _plane(trial) for name in names}
        parts.append(OpenEXR.Part(dict(plain), channels, f"part{k}"))
    content = io.BytesIO()
    OpenEXR.File(parts).write(content)
    return content.getvalue()


_CHANNELS = (
    *("RGB", "RGB", "RGBA", "Y", "YA", "A", "Z", "rgb"),
    *(("R", "G"), ("Y", "RY", "BY"), ("Y", "RGB"), ("diffuse.R", "diffuse.G", "diffuse.B")),
    *(("R", "G", "B", "depth.Z"), ("R.x", "G.x", "B.x"), ("ü",), ("x" * 200,)),
)
_EXRS: tuple[Callable[[Trial], bytes], ...] = (
    *(_plain_exr, _plain_exr, _plain_exr, _windowed_exr, _many_exr, _deep_exr, _parts_exr),
)


def _written(header: dict[str, object], channels: dict[str, np.ndarray]) -> bytes:
    content = io.BytesIO()
    plain = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File({**plain, **header}, channels).write(content)
    return content.getvalue()


def _chunk(name: bytes, data: bytes) -> bytes:
    checksum = zlib.crc32(name + data)
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", checksum)


def _lying(content: bytes, rng: random.Random) -> bytes:
    """A header that is well formed and names a wrong size."""
    width, height = (rng.choice((8, *_HUGE)) for _ in range(2))
    if content.startswith(b"\x89PNG") and len(content) > 33:
        header = struct.pack(">II", width % 2**32, height % 2**32) + content[24:29]
        return content[:8] + _chunk(b"IHDR", header) + content[33:]
    if content.startswith(b"\xff\xd8"):
        for marker in (b"\xff\xc0", b"\xff\xc2"):
            if (at := content.find(marker)) > 0:
                size = struct.pack(">HH", height % 2**16, width % 2**16)
                return content[: at + 5] + size + content[at + 9 :]
    name = b"dataWindow\0box2i\0"
    if content.startswith(b"\x76\x2f\x31\x01") and (at := content.find(name)) > 0:
        at += len(name) + 4
        high = [min(side, 2**31 - 1) for side in (width - 1, height - 1)]
        return content[:at] + struct.pack("<4i", 0, 0, *high) + content[at + 16 :]
    return damaged(content, rng)
