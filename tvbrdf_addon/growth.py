"""What a run asks of the surface that aging is to grow on."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..model_runtime.contract import AUTO, LIVE
from .errors import MaterialError

if TYPE_CHECKING:
    from .material.reading.lookup import Reading
    from .material.surface_maps.collect import UVMap

__all__ = ("Growth", "grows", "growth", "needs_no_texels")

_IN_FRAMES = (
    "Places that share texels age alike in frames: show the material live where they are to differ."
)


@dataclass(frozen=True)
class Growth:
    """`fields` of the request, and what is to be said, in sentences.

    `seconds` went into the maps; 0 where they were kept.  `uv_map` is one by which timing is then
    looked up, to be added to the meshes.
    """

    fields: dict[str, Any] = field(default_factory=dict)
    uv_map: UVMap | None = None
    notes: tuple[str, ...] = ()
    seconds: float = 0.0


def grows(request: dict[str, Any]) -> bool:
    """Whether a run of this request is to know the surface."""
    return request["onset"] == AUTO


def needs_no_texels(request: dict[str, Any]) -> bool:
    """Whether a place may age by a UV map that is made for it."""
    return grows(request) and request["binding"] == LIVE


def growth(
    request: dict[str, Any],
    material: bpy.types.Material,
    scene: bpy.types.Scene,
    reading: Reading,
    frame: int,
) -> Growth:
    """The surface that shows `material`, which was read, at `frame`.

    Raises `MaterialError` where there is none, nor texels of its own for a place to age by.
    """
    from .material.surface_maps.maps import write_surface

    kept = Path(bpy.app.tempdir) / "surfaces"
    maps = write_surface(
        *(material, scene, frame),
        uv_map=reading.laid_out_by,
        tiles=reading.tiles,
        alike=material.tvbrdf.use_alike,
        kept=kept,
    )
    apart = needs_no_texels(request)
    if maps.folder is None:
        if apart and reading.uniform and maps.notes:
            raise MaterialError(maps.notes[-1])
        return Growth(notes=maps.notes)
    if maps.own is None:
        return Growth({"surface": str(maps.folder)}, None, maps.notes, maps.seconds)
    if not apart:
        return Growth(notes=(_IN_FRAMES,), seconds=maps.seconds)
    fields = {"surface": str(maps.folder), "timing_apart": True}
    return Growth(fields, maps.own, maps.notes, maps.seconds)
