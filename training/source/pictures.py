"""The pictures of a time-lapse: an animated image, or numbered ones in a folder."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from model_runtime.errors import InputError, reason, shown
from model_runtime.images import EXTENSIONS, read_image
from model_runtime.memory import ran_out_of_memory
from model_runtime.resampling import resize

__all__ = ("is_timelapse", "read_pictures")

Array = NDArray[np.float32]

ANIMATED = (".webp", ".gif", ".apng")
VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v")

_MOST = 120  # pictures that are learned from, evenly spaced
_LARGEST = 384  # texels a side
_FEWEST = 5
_NUMBERED = re.compile(r"(.*?)[ _.-]*([0-9]+)")


def is_timelapse(path: Path) -> bool:
    """Whether `path` is an animation, a video, or a folder of numbered pictures of one name."""
    if path.is_dir():
        return len(_numbered(path)) >= _FEWEST
    return path.suffix.lower() in (*ANIMATED, *VIDEOS)


def read_pictures(path: Path) -> Array:
    """Linear color [T, H, W, 3] of a time-lapse: at most 120 pictures, evenly spaced, with at most
    384 texels a side.

    Raises InputError where they cannot be read, are fewer than five, or differ in size.
    """
    pictures: list[Array] = []
    for picture in _from_folder(path) if path.is_dir() else _from_animation(path):
        if pictures and picture.shape != pictures[0].shape:
            raise InputError(
                f"The pictures of {shown(path.name)} differ in size.", "Bring them to one size."
            )
        pictures.append(picture)
    if len(pictures) < _FEWEST:
        raise InputError(
            f"{shown(path.name)} has only {len(pictures)} pictures.",
            f"A time-lapse needs at least {_FEWEST}.",
        )
    return np.stack(pictures)


def _numbered(folder: Path) -> list[Path]:
    """The pictures of a folder in order, where nearly all are numbered and have one name."""
    found: dict[str, list[tuple[int, Path]]] = {}
    for file in folder.iterdir():
        match = _NUMBERED.fullmatch(file.stem)
        if match and file.suffix.lower() in EXTENSIONS:
            found.setdefault(f"{match[1]}{file.suffix.lower()}", []).append((int(match[2]), file))
    if len(found) != 1:
        return []
    return [file for _, file in sorted(next(iter(found.values())))]


def _evenly(count: int) -> list[int]:
    return np.unique(np.linspace(0, count - 1, min(count, _MOST)).round().astype(int)).tolist()


def _from_folder(folder: Path) -> Iterator[Array]:
    files = _numbered(folder)
    for k in _evenly(len(files)):
        yield _small(read_image(files[k], color=True))


def _from_animation(path: Path) -> Iterator[Array]:
    if path.suffix.lower() in VIDEOS:
        raise InputError(
            f"{shown(path.name)} is a video, which cannot be read here.",
            "Export its frames as numbered pictures, or as an animated WebP or GIF.",
        )
    try:
        with Image.open(path) as image:
            for k in _evenly(getattr(image, "n_frames", 1)):
                image.seek(k)
                code = np.asarray(image.convert("RGB"), np.float32) / 255
                curve = ((code + 0.055) / 1.055) ** 2.4
                yield _small(np.where(code <= 0.04045, code / 12.92, curve))
    except Exception as error:  # Pillow raises whatever a damaged file makes it
        if ran_out_of_memory(error):
            raise
        raise InputError(
            f"{shown(path.name)} is damaged or no animation: {reason(error)}.", "Save it again."
        ) from error


def _small(picture: Array) -> Array:
    height, width = picture.shape[:2]
    scale = min(1.0, _LARGEST / max(height, width))
    return resize(picture, (max(1, round(height * scale)), max(1, round(width * scale))))
