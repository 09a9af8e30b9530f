"""Reads a material into maps that the worker understands, and leaves the scene as it was."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import bpy
import numpy as np

from ....model_runtime.contract import EVERYWHERE
from ...errors import MaterialError
from ...known import image_texture, known, tree_of
from ..nodes.age import frame_range
from ..nodes.groups import own_groups, owned_groups, remove_unused
from ..nodes.ownership import user_count
from ..nodes.revert import revert
from ..nodes.surface import find_principled, why_not_in_eevee
from ..nodes.trace import SOCKETS, resolve, upstream
from .bake import Target, bake_sockets
from .cameras import FULL, TextureSize, all_the_cameras_see
from .check import why_not
from .doubts import baked_badly, lost, shared, unwrapped_badly
from .evaluated import Evaluated, distinct, evaluated
from .onset import is_painted, showing
from .pixels import Array, linear_color, luminance, resampled, write_exr
from .space import (
    Sampling,
    Space,
    choose_space,
    image_size,
    is_constant,
    is_direct,
    looked_up_by,
)
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
_NAMED = 5  # tiles in a sentence
_LOOKED_AT = 32  # objects
_COVERAGE = 256  # cells a side, of images' own space
# That the worker takes.
_MOST = {"Specular": 100.0, "IOR": 1000.0, "SpecularTint": 100.0}
_MOST_OF_A_COLOR = 65504.0


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


def read(
    *,
    material: bpy.types.Material,
    obj: bpy.types.Object | None,
    scene: bpy.types.Scene,
    folder: Path,
    size: int | None,
    frame: int | None = None,
    timed: bool = False,
) -> Reading:
    """Writes `BaseColor.exr`, `Metallic.exr`, ... (float, linear; 1 x 1 where constant).

    `folder` must exist.  `size` is the longer side in pixels of what has to be baked, images keep
    theirs; None makes all as large as the cameras see, and no image larger.  Of images with UDIM
    tiles each tile has that size; the maps show all that are needed, side by side.  What is
    animated is read at `frame`, by default the first of the material's range.  A material that is
    already aged is read as it was before.  `timed` says that its timing
    has a place of its own, which needs no UV map.  Where texels are known that no face covers,
    `Coverage.exr` has 0 there and more elsewhere.  Raises `MaterialError`.
    """
    frames = frame_range(material, scene)
    frame = frames[0] if frame is None else frame
    with ExitStack() as stack:
        copy = stack.enter_context(_original(material))
        reason = why_not(copy, obj, owner=material)
        if reason:
            raise MaterialError(reason)
        place = own_groups(find_principled(copy))
        groups = place.groups
        space = choose_space(place.principled, groups, painted=is_painted(material))
        sockets = {name: place.input(each) for name, each in SOCKETS.items()}
        behind = [pair for socket in sockets.values() for pair in upstream(socket, groups)]
        warnings: list[str] = []
        of_maps = tuple(lost(sockets, space, material, frame))
        if (unaged := why_not_in_eevee(place)) is not None:
            warnings.append(unaged)
        if space.kind == "uv" and choose_space(place.principled, groups).kind == "texture":
            warnings.append(
                f"The images of “{material.name}” are baked to the UV map, because what is painted "
                "on the mesh cannot be moved or tiled with them."
            )
        for socket in sockets.values():
            _check_images(socket, groups)
        maps = {
            name: _constant(socket, frame, groups)
            for name, socket in sockets.items()
            if is_constant(socket, groups)
        }
        direct = [
            image_texture(resolve(socket, groups).node)
            for socket in sockets.values()
            if space.kind == "texture" and is_direct(socket, groups)
        ]
        uniform = space.kind == "uniform"
        if size is None:
            depsgraph = bpy.context.evaluated_depsgraph_get()
            textures = all_the_cameras_see(material, space, scene, frames, depsgraph=depsgraph)
        else:
            textures = TextureSize(size, "")
        users = [known(obj)] if space.kind == "uv" else showing(material, scene)
        tiles = tiles_of(place.principled, space, material, users, frame)
        textured = uniform and material.tvbrdf.onset != EVERYWHERE and not timed
        looks = []
        if space.reads_uv or textured:
            if space.kind == "texture":
                users = showing(material)  # one texture serves those of other scenes, too
            seen = distinct([known(obj), *users])[:_LOOKED_AT]
            looks = [stack.enter_context(evaluated(each, frame)) for each in seen]
            require_uv_map(looks[0], needed=not uniform)
            if not timed:
                warnings += unwrapped_badly(looks, material, space)
        whole = _whole(space, direct, max(textures.pixels, FULL) if size is None else size)
        wanted = whole if size is not None else _shrunk(whole, textures.pixels)
        shape = _shrunk(wanted, _LARGEST // max(tiles.rows, tiles.columns))
        if shape != wanted:
            warnings.append(
                f"The textures of “{material.name}” are made {max(shape)} px large instead of "
                f"{max(wanted)}: one image, of all UDIM tiles, has at most {_LARGEST} px a side."
            )
        if tiles.lacking:
            some = ", ".join(tiles.lacking[:_NAMED]) + ", ..." * (len(tiles.lacking) > _NAMED)
            warnings.append(
                f"Faces of “{material.name}” lie where its images have no tile ({some}); there "
                "they will show what is next to them."
            )
        for name, socket in sockets.items():
            if name not in maps and direct and is_direct(socket, groups) and tiles.are_one:
                pixels = _image_map(socket, groups)
                if pixels is not None:
                    maps[name] = resampled(pixels, shape)
        rest = [name for name in sockets if name not in maps]
        sampling = Sampling.of(space.images[0], groups) if space.kind == "texture" else Sampling()
        uv_map, coverage = None, None
        if space.kind == "uv":
            require_faces(looks[0], material, frame)
            uv_map = known(active_uv_map(looks[0].mesh))
            if tiles.are_one:
                # What lies beside an island at the border is not what lies at the other border.
                sampling = replace(sampling, extension="EXTEND")
            target = Target(material, looks[0], uv_map, tiles, scene)
            coverage = _bake(maps, rest, copy, target, whole, shape, frame)
            warnings += baked_badly(target, coverage)
            warnings += shared(material, known(obj), scene, behind)
        elif rest:
            target = Target(material, tiles=tiles, scene=scene)
            _bake(maps, rest, copy, target, whole, shape, frame)
        laid_out_by = looked_up_by(space) if space.kind == "texture" else uv_map or ""
        if space.kind == "texture" and tiles.are_one:
            coverage = _covered(looks, users, material, space)
    if coverage is not None and not coverage.all():
        write_exr(folder / "Coverage.exr", coverage)
    for name, pixels in maps.items():
        write_exr(folder / f"{name}.exr", _bounded(name, pixels))
    size_of_maps = (1, 1) if uniform else tiles.whole(shape)
    return Reading(
        size_of_maps,
        textures,
        uniform,
        uv_map,
        tuple(warnings),
        sampling,
        tiles,
        of_maps,
        laid_out_by,
    )


@contextmanager
def _original(material: bpy.types.Material) -> Iterator[bpy.types.Material]:
    """A copy of the material as it was before any ageing, to read from and to bake with."""
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


def _whole(space: Space, direct: list[bpy.types.ShaderNodeTexImage], size: int) -> tuple[int, int]:
    """The size at which nothing is lost: that of the largest image, read as it is if there is one,
    or the largest tile.

    Where no image sets it, `size`; one of a single texel is a plain color, which does not.
    """
    if space.kind == "uniform":
        return (1, 1)
    if space.kind == "uv":
        return (size, size)
    tiled = [node for node in space.images if node.image.source == "TILED"]
    whole = max(
        (image_size(known(node.image)) for node in direct + tiled or space.images), key=math.prod
    )
    return (size, size) if whole == (1, 1) else whole


def _shrunk(whole: tuple[int, int], longer: int) -> tuple[int, int]:
    share = min(1.0, longer / max(whole))
    height, width = (max(1, round(length * share)) for length in whole)
    return height, width


def _constant(socket: bpy.types.NodeSocket, frame: int, groups: Sequence[bpy.types.Node]) -> Array:
    source = resolve(socket, groups)
    value = np.atleast_1d(np.array(_value_at(source, frame), np.float32))
    return _converted(socket, value[:3].reshape(1, 1, -1))


def _value_at(source: bpy.types.NodeSocket, frame: int) -> list[float]:
    """A socket's value at a frame: its F-curves there, and elsewhere what it shows now."""
    from ..nodes.animation import channels

    value = source.default_value
    values = list(value) if hasattr(value, "__len__") else [value]
    path = source.path_from_id("default_value")
    for curve in channels(tree_of(source)):
        if curve.data_path == path and not curve.mute:
            values[curve.array_index] = curve.evaluate(frame)
    return values


def _image_map(socket: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node]) -> Array | None:
    """The image that a socket shows; None where Cycles mixes its alpha into it, its own way."""
    node = resolve(socket, groups).node
    color = linear_color(node.image, alpha_is_used=node.outputs["Alpha"].is_linked)
    return None if color is None else _converted(socket, color)


def _converted(socket: bpy.types.NodeSocket, pixels: Array) -> Array:
    """Colours [H, W, 3] for colour sockets, numbers [H, W] for others, as Cycles converts them."""
    if socket.type == "RGBA":
        return np.broadcast_to(pixels, (*pixels.shape[:2], 3))
    return luminance(pixels)


def _bounded(name: str, pixels: Array) -> Array:
    """The values that the Principled BSDF really uses: it clamps what it is given."""
    if not np.isfinite(pixels).all():
        raise MaterialError(
            f"The {SOCKETS[name]} of the material is not a number in places.",
            "Look for a division by zero or a broken image among its nodes.",
        )
    if name in ("Metallic", "Roughness"):
        return np.clip(pixels, 0, 1)
    most = _MOST.get(name, _MOST_OF_A_COLOR)
    if pixels.max() > most:
        raise MaterialError(
            f"The {SOCKETS[name]} of the material is above {most:,.0f} in places.",
            "Lower what feeds it.",
        )
    return np.maximum(pixels, 1e-5 if name == "IOR" else 0)


def _bake(
    maps: dict[str, Array],
    names: list[str],
    copy: bpy.types.Material,
    target: Target,
    size: tuple[int, int],
    shape: tuple[int, int],
    frame: int,
) -> Array:
    """Adds maps, each tile baked at `size` and made as large as `shape`; the coverage."""
    identifiers = {SOCKETS[name]: name for name in names}
    look = target.look
    if look is not None and target.tiles.are_one:
        check_unwrapped(look, target.material, target.uv_map, max(size))
    size = _shrunk(size, _LARGEST_BAKE)
    baked, coverage = bake_sockets(
        copy, list(identifiers), target, size=size, frame=frame, shape=shape
    )
    if look is not None and not coverage.any():
        raise MaterialError(
            f"Cycles finds nothing of “{look.obj.name}” to bake to its UV map “{target.uv_map}”.",
            "Look at its scale, unwrap it (UV > Smart UV Project), or choose a larger size.",
        )
    maps |= {identifiers[each]: pixels for each, pixels in baked.items()}
    return coverage


def _covered(
    looks: Sequence[Evaluated],
    users: Sequence[bpy.types.Object],
    material: bpy.types.Material,
    space: Space,
) -> Array | None:
    """Where the faces of all users lie in the images' own space; None where that is not known."""
    uv_map = looked_up_by(space)
    if uv_map is None or len(looks) < len(distinct(users)):
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


def _check_images(socket: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node]) -> None:
    for node, _ in upstream(socket, groups):
        if node.type not in ("TEX_IMAGE", "TEX_ENVIRONMENT") or node.image is None:
            continue
        image = node.image
        if min(image_size(image)) == 0:  # asking for the size loads it, if it can be
            raise MaterialError(
                f"The image “{image.name}” cannot be loaded from {image.filepath or 'nowhere'}.",
                "Use File > External Data > Find Missing Files, or choose another image.",
            )
