"""The worker's result as the add-on reads it: `aged.json` and the files it speaks of."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy

from ...model_runtime.channels import lobe_maps, turning_in
from ...model_runtime.contract import (
    FORMATS,
    HEIGHT,
    LIVE,
    METERS,
    REPORT,
    frame_file,
)
from ...model_runtime.live.evaluate import BYTES, HALVES, Packing
from ...model_runtime.output.commit import recover
from ..errors import MaterialError
from .nodes.ownership import GROUP, TAG
from .nodes.record import tagged

__all__ = (
    "AgedMap",
    "AgedMaps",
    "LiveFiles",
    "Unit",
    "note_result",
    "read_result",
    "result_folder",
)


@dataclass(frozen=True)
class AgedMap:
    """One map over time: `files` for the modeled frames `stored`, counted from 0, and straight
    between them.

    One that never `changes` has one file; a `uniform` map has one texel.
    """

    name: str
    files: tuple[Path, ...]
    stored: tuple[int, ...]
    uniform: bool

    @property
    def changes(self) -> bool:
        return len(self.files) > 1


@dataclass(frozen=True)
class Unit:
    """How high a height of 1 is: a `length` in the world, or with `of_texture` a share of the
    textures' side.
    """

    length: float
    of_texture: bool

    def distance(self, texture_side: float) -> float:
        """In the world, where the textures' side has that length."""
        return self.length * (texture_side if self.of_texture else 1.0)


_WORLD = Unit(1.0, of_texture=False)


@dataclass(frozen=True)
class AgedMaps:
    """A whole result.  `times` are the ages of the modeled frames, rising from 0 to 1; the maps of
    further lobes are among them; `height` is None where nothing rises or sinks.
    """

    format: str
    times: tuple[float, ...]
    maps: tuple[AgedMap, ...]
    unit: Unit = _WORLD
    height: AgedMap | None = None


@dataclass(frozen=True)
class LiveFiles:
    """A result that a shader evaluates at any age: its files, of `size` (height, width).

    `timing` holds onset, rate and start of each texel (None: all age alike), `coefficients` as
    many in each texture as their `packing` says, the last `grain` of all being grain, `curves` what
    they are multiplied by.
    With `height` there is a change of it.  Of several lobes, those after the first age as
    `lobe_curves` say, and the result is the measurement that they show, whatever the artist's
    nodes say.
    """

    format: str
    size: tuple[int, int]
    timing: Path | None
    coefficients: tuple[Path, ...]
    curves: Path
    grain: int = 0
    height: bool = False
    unit: Unit = _WORLD
    lobes: int = 1
    lobe_curves: Path | None = None

    @property
    def packing(self) -> Packing:
        return HALVES if any(path.suffix == ".exr" for path in self.coefficients) else BYTES


def result_folder(material: bpy.types.Material) -> Path | None:
    """The folder of a material's result; None where it has none.

    Where it was written, or, in a file that was saved elsewhere or that the material was appended
    to, where its textures lie: Blender keeps the paths of images right, and of nothing else.
    """
    said = material.tvbrdf.folder
    if not said:
        return None
    written = Path(bpy.path.abspath(said, library=material.library))
    lie = (
        Path(bpy.path.abspath(image.filepath, library=image.library)).parent
        for image in _textures(material)
    )
    return next((each for each in (written, *lie) if (each / REPORT).is_file()), written)


def note_result(material: bpy.types.Material, folder: Path, size_reason: str) -> None:
    """Keep in the settings where the result that `material` shows lies, and why it has its size."""
    settings, place = material.tvbrdf, str(folder)
    settings.is_preview = False
    settings.folder = bpy.path.relpath(place) if _near_file(place) else place
    settings.size_reason = size_reason


def _near_file(folder: str) -> bool:
    """Whether a path relative to the .blend can lead to `folder` (not from drive to drive)."""
    saved = bpy.data.filepath
    return bool(saved) and Path(saved).drive == Path(folder).drive


def _textures(material: bpy.types.Material) -> Iterator[bpy.types.Image]:
    """Those that a result brought, in the material's tree and its group."""
    if material.node_tree is None:
        return
    ours = tagged(material.node_tree)
    for node in ours:
        if node.type == "GROUP" and node.node_tree is not None and GROUP in node.node_tree:
            ours.extend(node.node_tree.nodes)
    for node in ours:
        if node.type == "TEX_IMAGE" and node.image is not None and TAG in node.image:
            yield node.image


def read_result(folder: Path) -> AgedMaps | LiveFiles:
    """Reads `folder/aged.json` and looks at every file that it names.

    A run that was killed while it replaced the result is undone first.

    Raises `MaterialError` where a file is missing, or the format is unknown.
    """
    path = folder / REPORT
    try:
        recover(folder)
        data = json.loads(path.read_text(encoding="utf-8"))
        kind, times, files = str(data["format"]), tuple(map(float, data["times"])), data["files"]
        height, width = map(int, data["size"])
        unit, grain, lobes = _unit(data), int(data.get("grain", 0)), int(data.get("lobes", 1))
    except OSError as error:
        raise MaterialError(f"The result {path} cannot be read.", "Age the material again.") from (
            error
        )
    except (ValueError, KeyError, TypeError) as error:
        raise MaterialError(
            f"The result {path} is damaged ({error}).", "Age the material again."
        ) from error
    if kind not in FORMATS:
        raise MaterialError(
            f"The result {path} has the format “{kind}”, which this extension does not know.",
            "Update the extension, or age the material again.",
        )
    if data.get("binding") == LIVE:
        live = _live(folder, kind, (height, width), files)
        height = bool(data.get(HEIGHT))
        if live.lobe_curves is None:
            lobes = 1
        return replace(live, grain=grain, height=height, unit=unit, lobes=lobes)
    uniform = (height, width) == (1, 1)

    def aged(name: str) -> AgedMap:
        return _map(folder, name, files.get(name), len(times), uniform)

    names = (*FORMATS[kind], *lobe_maps(turning_in(files, lobes)))
    return AgedMaps(
        kind,
        times,
        tuple(map(aged, names)),
        height=aged(HEIGHT) if HEIGHT in files and not uniform else None,
        unit=unit if unit.of_texture else _WORLD,
    )


def _unit(data: Mapping[str, Any]) -> Unit:
    side = float(data.get("tile_side", 1))
    if not 0 < side < math.inf:
        raise ValueError(f"a tile side of {side}")
    return Unit(side, of_texture=data.get("tile_unit") != METERS)


def _live(folder: Path, kind: str, size: tuple[int, int], files: object) -> LiveFiles:
    match files:
        case {"curves": str(curves), "coefficients": [*coefficients]}:
            timing, lobes = files.get("timing"), files.get("lobes")
        case _:
            raise MaterialError(
                f"The result in {folder} does not say which files its curves and coefficients are.",
                "Age the material again.",
            )
    paths = [_there(folder / each) for each in (curves, *coefficients)]
    return LiveFiles(
        kind,
        size,
        timing and _there(folder / timing),
        tuple(paths[1:]),
        paths[0],
        lobe_curves=lobes and _there(folder / lobes),
    )


def _there(path: Path) -> Path:
    if not path.is_file():
        raise MaterialError(f"{path} is missing.", "Age the material again.")
    return path


def _map(folder: Path, name: str, files: object, frames: int, uniform: bool) -> AgedMap:
    stored = _stored(files, name, frames)
    if stored is None:
        raise MaterialError(
            f"The result in {folder} does not say which files make its {name} on every frame.",
            "Age the material again.",
        )
    paths = tuple(_there(folder / frame_file(name, frame)) for frame in stored)
    first = paths[0].read_bytes()
    changes = any(
        path.stat().st_size != len(first) or path.read_bytes() != first for path in paths[1:]
    )
    if not changes:
        paths, stored = paths[:1], stored[:1]
    return AgedMap(name, paths, stored, uniform)


def _stored(files: object, name: str, frames: int) -> tuple[int, ...] | None:
    """The frames that have a file of their own; None unless these make up all the others.

    `files` holds a file for every frame, or its mix: a list of files with their weights.
    """
    if not isinstance(files, list) or len(files) != frames:
        return None
    mixes = [[[each, 1.0]] if isinstance(each, str) else each for each in files]
    stored = tuple(k for k, mix in enumerate(mixes) if mix == [[frame_file(name, k), 1.0]])
    if stored == (0,):
        return stored if all(mix == mixes[0] for mix in mixes) else None
    return stored if stored[:1] == (0,) and stored[-1] == frames - 1 else None
