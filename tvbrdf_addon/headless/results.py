"""Results that another machine computed, bound to the materials of the file that is open."""

from __future__ import annotations

import shlex
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import bpy

from ...model_runtime.contract import AUTO, LIVE, REPORT, option
from ...model_runtime.errors import reason
from ..errors import MaterialError
from ..material.nodes.age import frame_range
from ..material.nodes.record import is_aged
from ..material.reading.chosen import object_named, object_with
from ..material.result import note_result, result_folder
from ..output import file_safe
from ..small_json import read_json

__all__ = ("bind_result", "result_of", "why_no_result")


def result_of(material: bpy.types.Material, results: Path) -> Path:
    """The folder that a run with the output folder `results` leaves the result of `material` in."""
    return results / file_safe(material.name)


def why_no_result(material: bpy.types.Material, results: Path) -> str | None:
    """One sentence why there is nothing in `results` to bind to `material`, or None."""
    folder, name = result_of(material, results), material.name
    places = Counter(_key(each) for each in bpy.data.materials if each.library is None)
    if places[_key(material)] > 1:
        return (
            f"“{name}” has the folder {folder.name} in common with another material: give it "
            "another name and age it again."
        )
    if not (folder / REPORT).is_file():
        return f"There is no result of “{name}” in {folder}."
    shown = result_folder(material) if is_aged(material) else None
    if shown is not None and shown.resolve() == folder.resolve():
        return f"“{name}” shows the result in {folder} already: age into another folder."
    return None


def bind_result(
    material: bpy.types.Material, scene: bpy.types.Scene, object_name: str, folder: Path
) -> tuple[str, ...]:
    """Shows the result in `folder` on `material`, as the run that made it would have: over the
    frames of its settings, by a UV map of its own where it was aged by one.  Returns warnings, a
    sentence each.

    It is laid out on the object called `object_name`, or else one that shows it.

    Raises:
        TvbrdfError: it cannot be; the material is as it was.
    """
    # Only now: numpy, which they need, has no part in starting Blender.
    from ..material.binding.bind import bind
    from ..material.reading.lookup import find
    from ..material.surface_maps.maps import own_uv_map

    settings = material.tvbrdf
    obj = (
        object_named(object_name, material, scene) if object_name else object_with(material, scene)
    )
    start, end = frame_range(material, scene)
    said = _Said.of(folder)
    with find(
        material=material,
        obj=obj,
        scene=scene,
        size=None if settings.use_camera_size else settings.size,
        frame=start,
        timed=said.timed,
    ) as found:
        reading = found.reading
    uv_map = None
    if said.apart:
        laid = {"uv_map": reading.laid_out_by, "tiles": reading.tiles, "alike": settings.use_alike}
        uv_map = own_uv_map(material, scene, start, **laid)
        if uv_map is None:
            raise MaterialError(
                f"“{material.name}” was aged by a UV map that its meshes, as they are, do not get.",
                "Age it again.",
            )
    warnings = bind(
        material=material,
        reading=reading,
        folder=folder,
        frame_start=start,
        frame_end=end,
        uv_map=uv_map,
    )
    note_result(material, folder, reading.textures.why)
    return warnings if said.live else (*warnings, *reading.lost)


@dataclass(frozen=True)
class _Said:
    """What the report of a result says of how it is to be shown: whether it is `live`, and was to
    be (`timed`: its timing may have a UV map that is made for it), and has one (`apart`).
    """

    live: bool
    timed: bool
    apart: bool

    @classmethod
    def of(cls, folder: Path) -> _Said:
        """Raises `MaterialError` where there is no report that can be understood."""
        path = folder / REPORT
        try:
            aged = read_json(path)
            words = shlex.split(aged["command"])
            asked = dict(pairwise(words)).get(option("binding"))
            timed = asked == LIVE and aged["onset"] == AUTO
            return cls(aged["binding"] == LIVE, timed, option("timing_apart") in words)
        except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
            raise MaterialError(
                f"The result {path} is damaged ({reason(error)}).", "Age the material again."
            ) from error


def _key(material: bpy.types.Material) -> str:
    # Steel and steel are one folder on some machines.
    return file_safe(material.name).casefold()
