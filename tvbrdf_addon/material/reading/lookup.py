"""How the maps of a material will lie, and by what textures made of them are looked up."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import bpy

from ....model_runtime.contract import EVERYWHERE
from ...errors import MaterialError
from ...known import known
from ..nodes.age import frame_range
from ..nodes.groups import owned_groups, remove_unused
from ..nodes.ownership import user_count
from ..nodes.revert import revert
from .bake import Target
from .cameras import FULL, TextureSize, all_the_cameras_see
from .check import why_not
from .doubts import lacking, lost, surprising, unwrapped_badly
from .evaluated import Evaluated, distinct, evaluated
from .onset import showing
from .passing import discard
from .space import Sampling, Space, image_size, looked_up_by
from .spread import texture_side
from .subject import Subject
from .tiles import Tiles, tiles_of
from .unwrap import active_uv_map, require_faces, require_uv_map

__all__ = ("Found", "Reading", "Sizes", "find", "shrunk")

_LARGEST = 16384  # pixels a side that the worker takes, and most GPUs
_LOOKED_AT = 32  # objects


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


@dataclass(frozen=True)
class Found:
    """What maps are to be made of, and for which objects (`looks`, the one that is read first);
    `reading` is what can be said before.
    """

    subject: Subject
    looks: list[Evaluated]
    target: Target
    sizes: Sizes
    reading: Reading


@contextmanager
def find(
    *,
    material: bpy.types.Material,
    obj: bpy.types.Object | None,
    scene: bpy.types.Scene,
    size: int | None,
    frame: int | None = None,
    timed: bool = False,
) -> Iterator[Found]:
    """Looks at a material as `read` does, whose arguments these are, and makes no maps.

    What is found lives as long as the context.  Raises `MaterialError`.
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
        sizes = Sizes.of(subject, size, textures, tiles)
        if sizes.made != sizes.wanted:
            warnings.append(_too_large(material, sizes))
        warnings += lacking(material, tiles)
        target = _target(subject, looks, tiles)
        uv_map = target.uv_map if space.kind == "uv" else None
        whole = tiles.whole(sizes.made)
        yield Found(
            subject,
            looks,
            target,
            sizes,
            Reading(
                size=(1, 1) if space.kind == "uniform" else whole,
                textures=textures,
                uniform=space.kind == "uniform",
                uv_map=uv_map,
                warnings=tuple(warnings),
                sampling=_sampling(space, subject.groups, tiles),
                tiles=tiles,
                lost=of_maps,
                laid_out_by=looked_up_by(space) if space.kind == "texture" else uv_map or "",
                texture_side=texture_side(material, space, tiles, whole, users),
            ),
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
        discard(copy)
        remove_unused(owned)
        if action and user_count(action) == 0:
            discard(action)


def _as_seen(subject: Subject, frames: tuple[int, int]) -> TextureSize:
    """As large as the cameras see the material."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return all_the_cameras_see(
        subject.material, subject.space, subject.scene, frames, depsgraph=depsgraph
    )


@dataclass(frozen=True)
class Sizes:
    """Sizes (height, width) of a tile: at which nothing is lost, and wanted, and made."""

    whole: tuple[int, int]
    wanted: tuple[int, int]
    made: tuple[int, int]

    @classmethod
    def of(cls, subject: Subject, size: int | None, textures: TextureSize, tiles: Tiles) -> Sizes:
        whole = _whole(subject, max(textures.pixels, FULL) if size is None else size)
        wanted = whole if size is not None else shrunk(whole, textures.pixels)
        return cls(whole, wanted, shrunk(wanted, _LARGEST // max(tiles.rows, tiles.columns)))


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


def shrunk(whole: tuple[int, int], longer: int) -> tuple[int, int]:
    share = min(1.0, longer / max(whole))
    height, width = (max(1, round(length * share)) for length in whole)
    return height, width


def _too_large(material: bpy.types.Material, sizes: Sizes) -> str:
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
