"""The worker's result as the add-on reads it: `aged.json` and the files it speaks of."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from ..errors import MaterialError

__all__ = ("MAPS", "AgedMap", "AgedMaps", "read_result")

MAPS = {
    "principled": ("base_color", "metallic", "specular", "roughness"),
    "principled-exact": ("base_color", "specular_tint", "roughness"),
    "torrance-sparrow": ("kd", "ks", "alpha"),
}
"""The maps of each format that `aged.json` may name."""


@dataclass(frozen=True)
class AgedMap:
    """One map over time, a file for every modelled frame.

    Where nothing `changes` all files are the same; a `uniform` map has one texel.
    """

    name: str
    files: tuple[Path, ...]
    changes: bool
    uniform: bool


@dataclass(frozen=True)
class AgedMaps:
    """A whole result.  `times` are the ages of the modelled frames, rising from 0 to 1."""

    format: str
    times: tuple[float, ...]
    maps: tuple[AgedMap, ...]


def read_result(folder: Path) -> AgedMaps:
    """Reads `folder/aged.json` and looks at every file that it names.

    Raises `MaterialError` where a file is missing, the result is sparse, or the format is unknown.
    """
    path = folder / "aged.json"
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        kind, times, files = str(data["format"]), tuple(map(float, data["times"])), data["files"]
        height, width = map(int, data["size"])
    except OSError as error:
        raise MaterialError(f"The result {path} cannot be read.", "Age the material again.") from (
            error
        )
    except (ValueError, KeyError, TypeError) as error:
        raise MaterialError(
            f"The result {path} is damaged ({error}).", "Age the material again."
        ) from error
    if kind not in MAPS:
        raise MaterialError(
            f"The result {path} has the format “{kind}”, which this extension does not know.",
            "Update the extension, or age the material again.",
        )
    uniform = (height, width) == (1, 1)
    maps = tuple(_map(folder, name, files.get(name), len(times), uniform) for name in MAPS[kind])
    return AgedMaps(kind, times, maps)


def _map(folder: Path, name: str, files: object, frames: int, uniform: bool) -> AgedMap:
    wanted = [f"{name}_{frame + 1:04d}.exr" for frame in range(frames)]
    if files != wanted:
        raise MaterialError(
            f"The result in {folder} does not hold one {name} file for every frame, so Blender "
            "cannot play it.",
            "Age the material again without --sparse.",
        )
    paths = tuple(folder / each for each in wanted)
    missing = next((path for path in paths if not path.is_file()), None)
    if missing:
        raise MaterialError(f"{missing} is missing.", "Age the material again.")
    first = paths[0].read_bytes()
    changes = any(
        path.stat().st_size != len(first) or path.read_bytes() != first for path in paths[1:]
    )
    return AgedMap(name, paths, changes, uniform)
