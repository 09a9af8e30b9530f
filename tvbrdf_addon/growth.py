"""What a run asks of the surface that aging is to grow on."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..model_runtime.contract import AUTO, LIVE
from . import lights, masks, properties
from .errors import MaterialError

if TYPE_CHECKING:
    from .material.reading.lookup import Reading
    from .material.surface_maps.collect import UVMap

__all__ = ("Growth", "grows", "growth", "needs_no_texels")

_IN_FRAMES = (
    "Places that share texels age alike in frames: show the material live where they are to differ."
)
_NO_MASK = "Without its shape nothing is known of where the mask lies: it counts for nothing."


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
    from .material.surface_maps.painted import Mask

    settings, uv_map = material.tvbrdf, reading.laid_out_by
    white = masks.means(settings)
    mask = None
    if white is not None:
        painted = settings.mask_source == masks.ATTRIBUTE
        mask = (
            Mask(settings.mask_attribute)
            if painted
            else Mask("", settings.mask_image, uv_map or "")
        )
    maps = write_surface(
        *(material, scene, frame),
        uv_map=uv_map,
        tiles=reading.tiles,
        alike=settings.use_alike,
        mask=mask,
        light=lights.asked(settings, properties.card_of(settings), scene),
        kept=Path(bpy.app.tempdir) / "surfaces",
    )
    apart = needs_no_texels(request)
    lost = () if mask is None else (_NO_MASK,)
    if maps.folder is None:
        if apart and reading.uniform and maps.notes:
            raise MaterialError(maps.notes[-1])
        return Growth(notes=(*lost, *maps.notes))
    if maps.own is not None and not apart:
        return Growth(notes=(*lost, _IN_FRAMES), seconds=maps.seconds)
    fields: dict[str, Any] = {"surface": str(maps.folder)}
    if maps.own is not None:
        fields["timing_apart"] = True
    if maps.mask is not None:
        fields |= {"mask": str(maps.mask), "mask_means": white}
    if maps.light is not None:
        fields["light"] = str(maps.light)
    return Growth(fields, maps.own, maps.notes, maps.seconds)
