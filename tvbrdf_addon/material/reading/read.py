"""Reads a material into maps that the worker understands, and leaves the scene as it was."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np

from ....model_runtime.contract import EVERYWHERE
from ....model_runtime.resampling import resize
from ...errors import MaterialError
from ...known import known
from ..nodes.age import frame_range
from ..nodes.groups import owned_groups, remove_unused
from ..nodes.ownership import user_count
from ..nodes.revert import revert
from ..nodes.trace import SOCKETS
from .bake import Target, bake_sockets
from .cameras import FULL, TextureSize, all_the_cameras_see
from .check import why_not
from .doubts import baked_badly, lacking, lost, shared, surprising, unwrapped_badly
from .evaluated import Evaluated, distinct, evaluated
from .onset import showing
from .pixels import Array, write_exr
from .shape import write_shape
from .space import Sampling, Space, image_size, looked_up_by
from .spread import texture_side
from .subject import Subject, write_maps
from .tiles import Tiles, tiles_of
from .unwrap import (
    active_uv_map,
    check_unwrapped,
    covered,
    require_faces,
    require_uv_map,
    slots_with,
    triangles,
)

__all__ = ("Reading", "read")

_LARGEST = 16384  # pixels a side that the worker takes, and most GPUs
_LARGEST_BAKE = 8192  # of which Cycles needs some GB
_LOOKED_AT = 32  # objects
_COVERAGE = 256  # cells a side, of images' own space


@dataclass(frozen=True)
class Reading:
    """What was read.  `size` is (height, width), (1, 1) where every map is one texel.

    `textures` is the size of what is made of the maps (of each of their `tiles`), textures also
    where they are one texel.
    `uv_map` names the UV map that the maps were baked to (None: they are not in UV space), and
    `sampling` says how textures made from them are looked up.  `warnings` are sentences, and `lost`
    those on what is lost where maps stand in for the material.
    `laid_out_by` is the UV map that textures made of the maps are looked up by (empty: that which
    each object renders with), None where it is not by one alone.
    `texture_side` is how long the longer side of such textures is in the world, on average.
    """

    size: tuple[int, int]
    textures: TextureSize
    uniform: bool
    uv_map: str | None
    warnings: tuple[str, ...]
    sampling: Sampling = field(default_factory=Sampling)
    tiles: Tiles = field(default_factory=Tiles)
    lost: tuple[str, ...] = ()
    laid_out_by: str | None = ""
    texture_side: float = 1.0


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
    frames = frame_range(material, scene)
    with ExitStack() as stack:
        copy = stack.enter_context(_original(material))
        if reason := why_not(copy, obj, owner=material):
            raise MaterialError(reason)
        subject = Subject.of(material, copy, scene, frames[0] if frame is None else frame)
        space = subject.space
        of_maps = tuple(lost(subject.sockets, space, material, subject.frame))
        warnings = surprising(subject.place, space, material)
        textures = _as_seen(subject, frames) if size is None else TextureSize(size, "")
        users = [known(obj)] if space.kind == "uv" else showing(material, scene)
        tiles = tiles_of(subject.place.principled, space, material, users, subject.frame)
        looks = _looks(stack, subject, obj, users, timed=timed)
        if not timed:
            warnings += unwrapped_badly(looks, material, space)
        sizes = _Sizes.of(subject, size, textures, tiles)
        if sizes.made != sizes.wanted:
            warnings.append(_too_large(material, sizes))
        warnings += lacking(material, tiles)
        target = _target(subject, looks, tiles)
        # The bake changes how the copy's images are looked up: what is asked of them comes first.
        uv_map = target.uv_map if space.kind == "uv" else None
        laid_out_by = looked_up_by(space) if space.kind == "texture" else uv_map or ""
        side = texture_side(material, space, tiles, tiles.whole(sizes.made), users)
        sampling = _sampling(space, subject.groups, tiles)
        if shape and tiles.are_one:
            write_shape(subject, sizes.made, folder)
        if space.kind == "uv":
            others = shared(material, known(obj), scene, subject.behind)
            maps, coverage = _maps(subject, target, sizes)
            warnings += [*baked_badly(target, known(coverage)), *others]
        else:
            in_images = space.kind == "texture" and tiles.are_one
            coverage = _covered(looks, material, laid_out_by) if in_images else None
            maps, _ = _maps(subject, target, sizes)
    if coverage is not None and not coverage.all():
        write_exr(folder / "Coverage.exr", coverage)
    write_maps(folder, maps)
    return Reading(
        size=(1, 1) if space.kind == "uniform" else tiles.whole(sizes.made),
        textures=textures,
        uniform=space.kind == "uniform",
        uv_map=uv_map,
        warnings=tuple(warnings),
        sampling=sampling,
        tiles=tiles,
        lost=of_maps,
        laid_out_by=laid_out_by,
        texture_side=side,
    )


@contextmanager
def _original(material: bpy.types.Material) -> Iterator[bpy.types.Material]:
    """A copy of the material as it was before any aging, to read from and to bake with."""
    copy = material.copy()
    try:
        revert(copy, owner=material)
        yield copy
    finally:
        data = copy.node_tree.animation_data if copy.node_tree else None
        action = data.action if data else None
        owned = [node.node_tree for node in owned_groups(copy.node_tree)] if copy.node_tree else []
        bpy.data.materials.remove(copy)
        remove_unused(owned)
        if action and user_count(action) == 0:
            bpy.data.actions.remove(action)


def _as_seen(subject: Subject, frames: tuple[int, int]) -> TextureSize:
    """As large as the cameras see the material."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return all_the_cameras_see(
        subject.material, subject.space, subject.scene, frames, depsgraph=depsgraph
    )


@dataclass(frozen=True)
class _Sizes:
    """Sizes (height, width) of a tile: at which nothing is lost, and wanted, and made."""

    whole: tuple[int, int]
    wanted: tuple[int, int]
    made: tuple[int, int]

    @classmethod
    def of(cls, subject: Subject, size: int | None, textures: TextureSize, tiles: Tiles) -> _Sizes:
        whole = _whole(subject, max(textures.pixels, FULL) if size is None else size)
        wanted = whole if size is not None else _shrunk(whole, textures.pixels)
        return cls(whole, wanted, _shrunk(wanted, _LARGEST // max(tiles.rows, tiles.columns)))


def _whole(subject: Subject, size: int) -> tuple[int, int]:
    """The size at which nothing is lost: that of the largest image, read as it is if there is one,
    or the largest tile.

    Where no image sets it, `size`; one of a single texel is a plain color, which does not.
    """
    space = subject.space
    if space.kind == "uniform":
        return (1, 1)
    if space.kind == "uv":
        return (size, size)
    tiled = [node for node in space.images if node.image.source == "TILED"]
    setting = [*subject.shown.values(), *tiled] or space.images
    whole = max((image_size(known(node.image)) for node in setting), key=math.prod)
    return (size, size) if whole == (1, 1) else whole


def _shrunk(whole: tuple[int, int], longer: int) -> tuple[int, int]:
    share = min(1.0, longer / max(whole))
    height, width = (max(1, round(length * share)) for length in whole)
    return height, width


def _too_large(material: bpy.types.Material, sizes: _Sizes) -> str:
    return (
        f"The textures of “{material.name}” are made {max(sizes.made)} px large instead of "
        f"{max(sizes.wanted)}: one image, of all UDIM tiles, has at most {_LARGEST} px a side."
    )


def _looks(
    stack: ExitStack,
    subject: Subject,
    obj: bpy.types.Object | None,
    users: Sequence[bpy.types.Object],
    *,
    timed: bool,
) -> list[Evaluated]:
    """The objects by whose UV maps textures are made or looked up, `obj` first; none if by none."""
    space, material = subject.space, subject.material
    uniform = space.kind == "uniform"
    textured = uniform and material.tvbrdf.onset != EVERYWHERE and not timed
    if not (space.reads_uv or textured):
        return []
    if space.kind == "texture":
        users = showing(material)  # one texture serves those of other scenes, too
    seen = distinct([known(obj), *users])[:_LOOKED_AT]
    looks = [stack.enter_context(evaluated(each, subject.frame)) for each in seen]
    require_uv_map(looks[0], needed=not uniform)
    return looks


def _target(subject: Subject, looks: Sequence[Evaluated], tiles: Tiles) -> Target:
    if subject.space.kind != "uv":
        return Target(subject.material, tiles=tiles, scene=subject.scene)
    require_faces(looks[0], subject.material, subject.frame)
    uv_map = known(active_uv_map(looks[0].mesh))
    return Target(subject.material, looks[0], uv_map, tiles, subject.scene)


def _sampling(space: Space, groups: Sequence[bpy.types.Node], tiles: Tiles) -> Sampling:
    """How textures made of the maps are looked up."""
    if space.kind == "texture":
        return Sampling.of(space.images[0], groups)
    if space.kind == "uv" and tiles.are_one:
        # What lies beside an island at the border is not what lies at the other border.
        return Sampling(extension="EXTEND")
    return Sampling()


def _maps(subject: Subject, target: Target, sizes: _Sizes) -> tuple[dict[str, Array], Array | None]:
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
    size = _shrunk(sizes.whole, _LARGEST_BAKE)
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
