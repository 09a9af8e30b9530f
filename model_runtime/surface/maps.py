"""Reads the maps of a surface from a folder: where each texel lies in the world, and how.

`position` (RGB, meters) and `normal` (RGB, unit), both of the world, are needed, as OpenEXR; `ao`,
`edge`, `sky` and `mask` (0 to 1), any image, are optional. Names of other tools will do:
`can_position.exr`, `can_normal_world.exr`, `can_ambient_occlusion.png`, `can_curvature.png`. A
texel is covered where its alpha is above 0 and its place and normal are known.
"""

from __future__ import annotations

import stat
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..contract import MaskMeaning
from ..errors import InputError, reason, shown
from ..images import EXTENSIONS, read_image, read_vectors
from ..maps import Pixels
from ..resampling import resize
from .atlas import Atlas
from .exposure import BLOCKED, SOUGHT

__all__ = ("read_light", "read_mask", "read_surface", "surface_files")

_NAMES = {
    "position": ("position", "position_world", "world_position", "pos"),
    "normal": ("normal_world", "world_space_normal", "normal_world_space", "world_normal"),
    "ao": ("ao", "ambient_occlusion", "occlusion"),
    "edge": ("edge", "edges"),
    "curvature": ("curvature",),
    "sky": ("sky",),
    "mask": ("mask", "ageing_mask"),
}
"""What a name ends with, for each map. `normal.exr` alone is a normal of the world too, beside a
position of this name; in sets of textures it is one of the tangent."""

_MOST_SIDE = 2048  # texels a side that are kept
_FARTHEST = 1e7  # meters from the world's origin
_UNIT = (0.5, 2.0)  # lengths that count as a unit normal's
_HINT = "Bake position and normal in world space as 32-bit OpenEXR."


def surface_files(folder: Path) -> dict[str, Path]:
    """The file of each map of a surface that `folder` holds, by name; none where it has no
    position and normal. Raises InputError for a folder that cannot be read.
    """
    try:
        files = sorted(each for each in folder.iterdir() if each.suffix.lower() in EXTENSIONS)
    except OSError as error:
        raise InputError(f"{shown(folder)} cannot be read: {reason(error)}.", _HINT) from error
    stems = {_plain(each.stem): each for each in reversed(files)}
    found = {}
    for name, endings in _NAMES.items():
        exact = next((stems[each] for each in endings if each in stems), None)
        tail = (
            file for stem, file in stems.items() if stem.endswith(tuple(f"_{e}" for e in endings))
        )
        if (file := exact or next(tail, None)) is not None:
            found[name] = file
    if "normal" not in found and "position" in stems and "normal" in stems:
        found["normal"] = stems["normal"]
    return found if {"position", "normal"} <= set(found) else {}


def _plain(stem: str) -> str:
    return stem.lower().replace("-", "_").replace(" ", "_").replace(".", "_")


def read_surface(folder: Path) -> Atlas:
    """The surface whose maps `folder` holds; the very same as long as none of their files changes
    and no other is read.

    Raises InputError with what is wrong and what to do.
    """
    files = surface_files(folder)
    if not files:
        raise InputError(f"{shown(folder)} holds no position.exr and normal.exr.", _HINT)
    for file in files.values():
        _check(folder, file)
    return _read(tuple((*item, _stamp(item[1])) for item in files.items()))


def read_mask(file: Path, means: MaskMeaning, atlas: Atlas) -> dict[str, Pixels]:
    """What an image, 0 to 1, that is laid out as `atlas` is and `means` this where it is white says
    of its texels (`MARKS`): [H, W].
    """
    white = _read_scalar(file, atlas.size)
    if means == "first":
        return {SOUGHT: white}
    return {BLOCKED: white if means == "never" else 1 - white}


def read_light(file: Path) -> Pixels:
    """The light that an image laid out as a surface says falls on it: [h, w], 0 or more, 1 for all
    of it, NaN where the image does not know. Raises InputError for one that knows nothing.
    """
    pixels = read_image(file, color=False).clip(0)
    if not np.isfinite(pixels).any():
        raise InputError(f"{shown(file.name)} shows no light, not even none.", "Bake it again.")
    return pixels


def _stamp(file: Path) -> tuple[int, ...]:
    """What differs between two versions of a file."""
    status = file.stat()
    return status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns


@lru_cache(maxsize=1)
def _read(found: tuple[tuple[str, Path, tuple[int, ...]], ...]) -> Atlas:
    """The surface of these files, each with its name and stamp: an artist tries exposures on one
    object, so that the last is kept.
    """
    files = {name: file for name, file, _ in found}
    position, alpha = _read_vectors(files["position"])
    normal, _ = _read_vectors(files["normal"])
    if normal.shape != position.shape:
        raise InputError(
            f"{shown(files['normal'].name)} has another size than {shown(files['position'].name)}.",
            "Bake both at one size.",
        )
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.sqrt((normal * normal).sum(-1))
        near = (np.abs(position) < _FARTHEST).all(-1)
        covered = (alpha > 0) & near & (length > _UNIT[0]) & (length < _UNIT[1])
    if not covered.any():
        raise InputError(
            f"{shown(files['position'].name)} and {shown(files['normal'].name)} show no face "
            "anywhere.",
            _HINT,
        )
    position[~covered], normal[~covered] = 0, 0
    normal /= np.where(covered, length, 1)[..., None]
    origin = _origin(position[covered])
    position[covered] -= np.array(origin, np.float32)
    features = _features(files, covered.shape[:2])
    return Atlas(position, normal, covered, origin, features)


def _origin(position: Pixels) -> tuple[float, float, float]:
    """A place near all, the same for all maps of a surface: a node of a coarse grid."""
    low, high = (extreme.astype(np.float64) for extreme in (position.min(0), position.max(0)))
    step = 8 * 2.0 ** np.ceil(np.log2(max((high - low).max(), 1e-6)))
    x, y, z = (np.round((low + high) / 2 / step) * step).tolist()
    return x, y, z


def _check(folder: Path, file: Path) -> None:
    """Raise InputError for what is no file of this folder."""
    try:
        resolved = file.resolve(strict=True)
        inside = resolved.is_relative_to(folder.resolve())
        regular = stat.S_ISREG(resolved.stat().st_mode)
    except (OSError, RuntimeError) as error:
        raise InputError(
            f"{shown(file.name)} cannot be read: {reason(error)}.", "Check the path."
        ) from error
    if not (inside and regular):
        raise InputError(f"{shown(file.name)} is not a file of its folder.", "Copy it there.")


def _read_vectors(file: Path) -> tuple[Pixels, Pixels]:
    """[H, W, 3] and alpha [H, W] of every so many texels, so that no side is endless."""
    if file.suffix.lower() != ".exr":
        raise InputError(f"{shown(file.name)} cannot hold places of the world.", _HINT)
    pixels = read_vectors(file, most=_MOST_SIDE)
    return pixels[..., :3].copy(), pixels[..., 3].copy()


def _features(files: dict[str, Path], size: tuple[int, int]) -> dict[str, Pixels]:
    maps = {
        name: _read_scalar(file, size)
        for name, file in files.items()
        if name not in ("position", "normal")
    }
    features = {}
    if "curvature" in maps:  # gray is flat, white sticks out, black lies deep
        features["edges"] = (2 * maps["curvature"] - 1).clip(0, 1)
        features["crevices"] = (1 - 2 * maps["curvature"]).clip(0, 1)
    if "edge" in maps:
        features["edges"] = maps["edge"]
    if "ao" in maps:
        features["crevices"] = 1 - maps["ao"]
    if "sky" in maps:
        features["sky"] = maps["sky"]
    if "mask" in maps:
        features[BLOCKED] = maps["mask"]
    return features


def _read_scalar(file: Path, size: tuple[int, int]) -> Pixels:
    pixels = np.nan_to_num(read_image(file, color=False), nan=0.0, posinf=1.0, neginf=0.0)
    return resize(pixels.clip(0, 1), size)
