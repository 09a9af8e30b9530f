"""Reads what `--input` names: the maps of a material, or a measured BRDF.

Maps of one material may differ in resolution, not in shape: all are brought to the largest. A map
of 1 x 1 is a constant. Where texels of an unwrapped object are no face's, a map `Coverage.exr`
(one channel, of any size) may say so: texels where it is 0 count nowhere, and what lies next to
faces looks like these.
"""

from __future__ import annotations

import hashlib
import stat
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..brdf import merl, rgl
from ..brdf.measured import MeasuredBRDF
from ..errors import InputError, UsageError, reason, shown
from ..images import MAX_SIDE, read_image, read_packed
from ..maps import HALF_MAX, Pixels, PrincipledMaps, TorranceSparrowMaps
from ..resampling import resize
from .coverage import Coverage
from .texture_names import choose_maps

__all__ = ("Material", "hash_file", "hash_input", "input_files", "read_covered", "read_input")

Material = TorranceSparrowMaps | PrincipledMaps | MeasuredBRDF

_MEASURED = {".binary": merl.read, ".bsdf": rgl.read}
_TORRANCE_SPARROW = ("kd", "ks", "alpha")
_COLORS = ("base_color", "specular_tint", "kd", "ks")
_DEFAULTS = {"metallic": 0.0, "specular": 0.5, "roughness": 0.5, "ior": 1.5, "specular_tint": 1.0}
_MOST = {"specular": 100.0, "ior": 1000.0, "specular_tint": 100.0}
"""The largest number that a map may hold, by name; of all others, reflectances, it is that of half
floats. So is any Ks that these make together: F0 is at most twice the level, times the tint."""

_UP_TO_ONE = ("metallic", "roughness", "gloss", "alpha", "packed")
_KINDS = (
    "Give a folder of texture maps, a folder with kd.exr, ks.exr and alpha.exr, "
    "a MERL .binary or an RGL .bsdf."
)
_COVERAGE = "coverage.exr"
_ASPECT_TOLERANCE = 0.01


def read_input(path: str | Path, *, size: int | None = None) -> Material:
    """Read the material at `path`; `size` is the wanted length in texels of the longer side.

    A uniform material (every map 1 x 1) stays 1 x 1 whatever `size` is. Metallic, roughness and
    alpha above 1 count as 1, as in Blender; missing maps have Blender's defaults. Raises InputError
    with what is wrong and what to do, UsageError for a size out of range. What no face covers
    shows the nearest texel that one does.
    """
    if size is not None and not 1 <= size <= MAX_SIDE:
        raise UsageError(f"The size {size} is out of range.", f"Choose 1 to {MAX_SIDE} pixels.")
    path = Path(path)
    if _is_folder(path):
        files = _choose_files(path)
        maps = _read_maps(files, size, _coverage(files.pop("coverage", None)))
        return _torrance_sparrow(maps) if "kd" in maps else _principled(maps)
    return _MEASURED[path.suffix.lower()](path)


def read_covered(path: str | Path, size: tuple[int, int]) -> NDArray[np.bool_] | None:
    """Which texels [H, W] of the material at `path`, read at that size, a face covers; None where
    all do, as far as is known.
    """
    path = Path(path)
    coverage = _coverage(_choose_files(path).get("coverage")) if _is_folder(path) else None
    if coverage is None or size == (1, 1):
        return None
    covered = coverage.at(size)
    return None if covered.all() else covered


def hash_input(path: str | Path) -> dict[str, str]:
    """SHA-256 of every file that `read_input` reads, by name: what makes a run repeatable."""
    files = sorted(set(input_files(path).values()))
    return {file.name: hash_file(file) for file in files}


def input_files(path: str | Path) -> dict[str, Path]:
    """Every file that `read_input` reads, by what it holds."""
    path = Path(path)
    return _choose_files(path) if _is_folder(path) else {"measured": path}


def hash_file(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(
            f"{shown(path)} cannot be read: {reason(error)}.", "Check the path."
        ) from error


def _is_folder(path: Path) -> bool:
    """True for a folder, False for a measured file, InputError for everything else."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as error:
        raise InputError(
            f"{shown(path)} cannot be read: {reason(error)}.", "Check the path."
        ) from error
    if stat.S_ISDIR(mode):
        return True
    if not stat.S_ISREG(mode) or path.suffix.lower() not in _MEASURED:
        raise InputError(f"{shown(path.name)} is not a material that can be read.", _KINDS)
    return False


def _choose_files(folder: Path) -> dict[str, Path]:
    """The file of each map of a folder."""
    try:
        names = sorted(entry.name for entry in folder.iterdir())
    except OSError as error:
        raise InputError(f"{shown(folder)} cannot be read: {reason(error)}.", _KINDS) from error
    torrance_sparrow = {
        Path(name).stem.lower(): name
        for name in names
        if name.lower() in [f"{map_name}.exr" for map_name in _TORRANCE_SPARROW]
    }
    if "kd" in torrance_sparrow or "ks" in torrance_sparrow:
        missing = [f"{name}.exr" for name in _TORRANCE_SPARROW if name not in torrance_sparrow]
        if missing:
            raise InputError(f"{shown(folder)} lacks {' and '.join(missing)}.", _KINDS)
        chosen = torrance_sparrow
    else:
        chosen = choose_maps(folder, names)
    if (name := next((each for each in names if each.lower() == _COVERAGE), None)) is not None:
        chosen["coverage"] = name
    return {name: _inside(folder, file) for name, file in chosen.items()}


def _inside(folder: Path, name: str) -> Path:
    """The file `name`, which must be a regular file that does not lie elsewhere."""
    path, file = folder / name, shown(name)
    try:
        resolved = path.resolve(strict=True)
        regular = stat.S_ISREG(resolved.stat().st_mode)
    except PermissionError as error:
        raise InputError(f"{file} cannot be read: {reason(error)}.", "Check the path.") from error
    except (OSError, RuntimeError) as error:  # RuntimeError: links in a circle
        raise InputError(f"{file} is a link that leads nowhere.", "Remove it.") from error
    if not resolved.is_relative_to(folder.resolve()):
        raise InputError(f"{file} is a link out of its folder.", "Copy the image into the folder.")
    if not regular:
        raise InputError(f"{file} is not a file.", "Remove it.")
    return path


def _coverage(file: Path | None) -> Coverage | None:
    if file is None:
        return None
    texels = read_image(file, color=False) > 0
    return Coverage(texels) if texels.any() else None


def _read_map(name: str, file: Path, coverage: Coverage | None) -> Pixels:
    """One map, checked texel by texel."""
    pixels = read_packed(file) if name == "packed" else read_image(file, color=name in _COLORS)
    if coverage is not None:
        pixels = coverage.filled(pixels)
    most = _MOST.get(name, HALF_MAX)
    if not (pixels.min() >= 0 and pixels.max() <= most):  # nor NaN
        raise _refused(file, pixels, most)
    return pixels.clip(max=1) if name in _UP_TO_ONE else pixels


def _refused(file: Path, pixels: Pixels, most: float) -> InputError:
    """Says which texels of `pixels` cannot be, or are above `most`."""
    texels = pixels.reshape(*pixels.shape[:2], -1)
    checks = {
        "NaN or infinite": ~np.isfinite(texels),
        "negative": texels < 0,
        f"above {most:,.0f}": texels > most,
    }
    what, wrong = next((what, found.any(-1)) for what, found in checks.items() if found.any())
    y, x = np.argwhere(wrong)[0]
    return InputError(
        f"{shown(file.name)} has {np.count_nonzero(wrong)} texels that are {what}, "
        f"the first in row {y}, column {x}.",
        "Repair the map, or export it again.",
    )


def _read_maps(
    files: Mapping[str, Path], size: int | None, coverage: Coverage | None
) -> dict[str, Pixels]:
    """All maps at the size of the largest, or with `size` texels along the longer side."""
    maps: dict[str, Pixels] = {}
    shapes: dict[str, tuple[int, int]] = {}
    for name, file in files.items():
        pixels = _read_map(name, file, coverage)
        shapes[name] = (pixels.shape[0], pixels.shape[1])
        # Large maps shrink one by one, so that only one is held at its full size.
        shrinks = size is not None and max(shapes[name]) > size
        maps[name] = resize(pixels, _scaled(shapes[name], size)) if shrinks else pixels

    largest = max(shapes, key=lambda name: shapes[name][0] * shapes[name][1])
    height, width = shapes[largest]
    for name, (h, w) in shapes.items():
        if (h, w) != (1, 1) and abs(h * width / (w * height) - 1) > _ASPECT_TOLERANCE:
            raise InputError(
                f"{shown(files[name].name)} has {w} x {h} pixels and {shown(files[largest].name)} "
                f"{width} x {height}, which is another shape.",
                "Give all maps of the material one shape.",
            )
    shape = (height, width) if (height, width) == (1, 1) else _scaled((height, width), size)
    return {name: resize(pixels, shape) for name, pixels in maps.items()}


def _scaled(shape: tuple[int, int], size: int | None) -> tuple[int, int]:
    """`shape` with `size` texels along its longer side, unchanged where that is None."""
    if size is None:
        return shape
    scale = size / max(shape)
    return max(1, round(shape[0] * scale)), max(1, round(shape[1] * scale))


def _torrance_sparrow(maps: Mapping[str, Pixels]) -> TorranceSparrowMaps:
    return TorranceSparrowMaps(maps["kd"], maps["ks"], maps["alpha"])


def _principled(maps: Mapping[str, Pixels]) -> PrincipledMaps:
    base_color = maps["base_color"]
    if "packed" in maps:
        _, roughness, metallic = np.ascontiguousarray(maps["packed"].transpose(2, 0, 1))
        maps = {"roughness": roughness, "metallic": metallic, **maps}

    def of(name: str) -> Pixels:
        if name in maps:
            return maps[name]
        shape = base_color.shape if name in _COLORS else base_color.shape[:2]
        return np.broadcast_to(np.float32(_DEFAULTS[name]), shape)

    return PrincipledMaps(
        base_color=base_color,
        metallic=of("metallic"),
        specular=of("specular"),
        roughness=1 - maps["gloss"] if "gloss" in maps else of("roughness"),
        ior=of("ior"),
        specular_tint=of("specular_tint"),
    )
