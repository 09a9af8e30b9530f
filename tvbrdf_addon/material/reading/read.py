"""Reads a material into maps that the worker understands, and leaves the scene as it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ....model_runtime.resampling import resize
from ...errors import MaterialError
from ...known import known
from ..nodes.trace import SOCKETS
from .bake import Target, bake_sockets
from .doubts import baked_badly, shared
from .evaluated import Evaluated, distinct
from .lookup import Reading, Sizes, find, shrunk
from .onset import showing
from .pixels import Array, write_exr
from .shape import write_shape
from .subject import Subject, write_maps
from .unwrap import active_uv_map, check_unwrapped, covered, slots_with, triangles

__all__ = ("read",)

_LARGEST_BAKE = 8192  # of which Cycles needs some GB
_COVERAGE = 256  # cells a side, of images' own space


def read(
    *,
    material: bpy.types.Material,
    obj: bpy.types.Object | None,
    scene: bpy.types.Scene,
    folder: Path,
    size: int | None,
    frame: int | None = None,
    timed: bool = False,
    shape: bool = False,
) -> Reading:
    """Writes `BaseColor.exr`, `Metallic.exr`, ... (float, linear; 1 x 1 where constant).

    `folder` must exist.  `size` is the longer side in pixels of what has to be baked, images keep
    theirs; None makes all as large as the cameras see, and no image larger.  Of images with UDIM
    tiles each tile has that size; the maps show all that are needed, side by side.  What is
    animated is read at `frame`, by default the first of the material's range.  A material that is
    already aged is read as it was before.  `timed` says that its timing
    has a place of its own, which needs no UV map.  Where texels are known that no face covers,
    `Coverage.exr` has 0 there and more elsewhere.  With `shape` there are also what maps of its
    relief the material has (`write_shape`).  Raises `MaterialError`.
    """
    with find(
        material=material, obj=obj, scene=scene, size=size, frame=frame, timed=timed
    ) as found:
        subject, target, reading = found.subject, found.target, found.reading
        warnings, coverage = reading.warnings, None
        if shape and reading.tiles.are_one:
            write_shape(subject, found.sizes.made, folder)
        if subject.space.kind == "uv":
            # The bake changes how the copy's images are looked up: asked before.
            others = shared(material, known(obj), scene, subject.behind)
            maps, coverage = _maps(subject, target, found.sizes)
            warnings = (*warnings, *baked_badly(target, known(coverage)), *others)
        else:
            if subject.space.kind == "texture" and reading.tiles.are_one:
                coverage = _covered(found.looks, material, reading.laid_out_by)
            maps, _ = _maps(subject, target, found.sizes)
    if coverage is not None and not coverage.all():
        write_exr(folder / "Coverage.exr", coverage)
    write_maps(folder, maps)
    return replace(reading, warnings=warnings)


def _maps(subject: Subject, target: Target, sizes: Sizes) -> tuple[dict[str, Array], Array | None]:
    """The maps of all sockets, of which those are baked that cannot be had otherwise, and where
    the bake found faces; None without a bake.
    """
    maps = subject.constants()
    if target.tiles.are_one:
        maps |= {name: resize(each, sizes.made) for name, each in subject.images().items()}
    names = {SOCKETS[name]: name for name in subject.sockets if name not in maps}
    if not names:
        return maps, None
    look = target.look
    if look is not None and target.tiles.are_one:
        check_unwrapped(look, target.material, target.uv_map, max(sizes.whole))
    size = shrunk(sizes.whole, _LARGEST_BAKE)
    baked, coverage = bake_sockets(
        subject.copy, list(names), target, size=size, frame=subject.frame, shape=sizes.made
    )
    if look is not None and not coverage.any():
        raise MaterialError(
            f"Cycles finds nothing of “{look.obj.name}” to bake to its UV map “{target.uv_map}”.",
            "Look at its scale, unwrap it (UV > Smart UV Project), or choose a larger size.",
        )
    return maps | {names[each]: pixels for each, pixels in baked.items()}, coverage


def _covered(
    looks: Sequence[Evaluated], material: bpy.types.Material, uv_map: str | None
) -> Array | None:
    """Where the faces of all users lie on `uv_map` (empty: each one's own); None where that is not
    known.
    """
    if uv_map is None or len(looks) < len(distinct(showing(material))):
        return None
    cells = np.zeros((_COVERAGE, _COVERAGE), bool)
    for look in looks:
        name = uv_map or active_uv_map(look.mesh)
        if name is None or name not in look.mesh.uv_layers:
            return None
        if not cells.all():
            _, uv = triangles(look.mesh, slots_with(look.mesh, material), name)
            cells |= covered(uv, _COVERAGE)
    return cells.astype(np.float32) if cells.any() else None
