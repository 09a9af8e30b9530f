"""Folders of numbered maps, read one after the other, whole or in part."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model_runtime.errors import InputError, reason, shown
from model_runtime.images import read_image
from model_runtime.maps import HALF_MAX
from model_runtime.model_files.card import MOST_AGES, strict_json

__all__ = (
    "MOST_TEXELS",
    "Array",
    "Crop",
    "Folder",
    "Kept",
    "Sample",
    "frame_count",
    "numbered",
    "part_of",
    "stack",
)

Array = NDArray[np.float32]
Crop = tuple[slice, slice]
Kept = Callable[[Array], Array]

MOST_TEXELS = 1 << 28
"""Of a map in all frames: 36 of 2,730 x 2,730, which take 3 GB."""

_LARGEST_JSON = 1 << 20


@dataclass(frozen=True)
class Sample:
    """At most `count` texels of a map, the same ones for the same size and `seed`."""

    count: int
    seed: int

    def __call__(self, image: Array) -> Array:
        """Those of an image [H, W, D], as one column [n, 1, D]."""
        texels = image.reshape(-1, 1, image.shape[-1])
        if len(texels) <= self.count:
            return texels
        rng = np.random.default_rng(self.seed)
        return texels[np.sort(rng.choice(len(texels), self.count, replace=False))]


@dataclass(frozen=True)
class Folder:
    """A folder and the names in it, looked up once; as text, its path for a sentence."""

    path: Path
    names: frozenset[str]

    @classmethod
    def of(cls, path: Path) -> Folder:
        try:
            return cls(path, frozenset(entry.name for entry in path.iterdir()))
        except (FileNotFoundError, NotADirectoryError) as error:
            raise InputError(
                f"There is no folder {shown(path)}.", "Name a folder that holds a sequence of maps."
            ) from error
        except (OSError, ValueError) as error:  # ValueError: no path at all
            raise InputError(
                f"The folder {shown(path)} cannot be read: {reason(error)}.", "Check the path."
            ) from error

    def __str__(self) -> str:
        return shown(self.path)

    def json(self, name: str) -> Any:
        """What the file `name` holds. Raises ValueError or OSError for what is no small JSON."""
        path = self.path / name
        if not path.is_file() or path.stat().st_size > _LARGEST_JSON:
            raise ValueError("it is no file of this kind")
        return strict_json(path.read_bytes())


def frame_count(folder: Folder, name: str) -> int:
    """Number of files `name_0001.exr` .. without a gap, from two to 1,000."""
    pattern = re.compile(re.escape(name) + r"_([0-9]{4,})\.exr")
    found = {int(m[1]) for file in folder.names if (m := pattern.fullmatch(file))}
    # Not up to the highest number, which may be anything.
    missing = next(k for k in range(1, len(found) + 2) if k not in found)
    if missing <= len(found) or not found:
        raise InputError(
            f"The sequence in {folder} lacks {name}_{missing:04d}.exr.",
            "Number the frames from 0001 without gaps.",
        )
    if len(found) < 2:
        raise InputError(
            f"The sequence in {folder} has only one frame.", "It needs at least two to show change."
        )
    if len(found) > MOST_AGES:
        raise InputError(
            f"The sequence in {folder} has {len(found):,} frames.",
            f"Leave out all but {MOST_AGES:,}.",
        )
    return len(found)


def numbered(name: str, frames: int) -> list[str]:
    """The names of so many frames of a map."""
    return [f"{name}_{k:04d}.exr" for k in range(1, frames + 1)]


def part_of(crop: Crop | None) -> Kept:
    """Keeps (rows, columns) of an image, or all of it."""
    return lambda image: image if crop is None else image[crop]


def stack(folder: Folder, files: list[str], frames: int, kept: Kept) -> Array:
    """What is `kept` of images of one size, as float32 [N, H, W, 3], from which `frames` frames are
    made.
    """
    found: list[Array] = []
    shape: tuple[int, ...] | None = None
    for file in files:
        if file not in folder.names:
            raise InputError(f"The sequence in {folder} lacks {file}.", "Add the file.")
        image = read_image(folder.path / file, color=True)
        shape = shape or image.shape
        if image.shape != shape:
            raise InputError(
                f"{file} differs in size from {files[0]} in {folder}.",
                "Bring all maps to one size.",
            )
        height, width, _ = image.shape
        if frames * height * width > MOST_TEXELS:
            raise InputError(
                f"The sequence in {folder} has {frames} frames of {width} x {height} texels.",
                "Make them smaller, or leave some out: a model learns from 8,192 texels.",
            )
        if not bool((np.abs(image) <= HALF_MAX).all()):  # nor NaN
            raise InputError(
                f"{shown(folder.path / file)} holds values that are not numbers, "
                f"or beyond {HALF_MAX:,.0f}.",
                "Write the map again without them.",
            )
        found.append(kept(image))
    images = np.stack(found)
    if images.size == 0:
        raise InputError(
            f"Nothing of {files[0]} in {folder} is left inside the crop.",
            "Choose a crop inside the maps.",
        )
    return images
