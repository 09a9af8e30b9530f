"""In which space a material's maps live: nowhere (uniform), in its own textures', or in its UVs."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import bpy
import imbuf
import mathutils

from ...known import known
from ..nodes.trace import POINTWISE, SOCKETS, input_socket, resolve, signature, upstream

__all__ = (
    "Sampling",
    "Space",
    "choose_space",
    "image_size",
    "image_sizes",
    "is_constant",
    "is_direct",
    "looked_up_by",
)


@dataclass(frozen=True)
class Sampling:
    """How aged textures are looked up: the way the artist's own images were, or by UV.

    `node` and `socket` name the artist's output socket that feeds Vector; None is plain UV.  It is
    in the material's own tree at `depth` 0, in its Principled BSDF's outermost group at 1, ...
    """

    node: str | None = None
    socket: str | None = None
    depth: int = 0
    projection: str = "FLAT"
    projection_blend: float = 0.0
    extension: str = "REPEAT"
    interpolation: str = "Linear"

    @classmethod
    def of(
        cls, image_node: bpy.types.ShaderNodeTexImage, groups: Sequence[bpy.types.Node] = ()
    ) -> Sampling:
        source = resolve(input_socket(image_node, "Vector"), groups)
        inside = [group.node_tree for group in groups]
        return cls(
            node=source.node.name if source.is_output else None,
            socket=source.identifier if source.is_output else None,
            depth=inside.index(source.id_data) + 1 if source.id_data in inside else 0,
            projection=image_node.projection,
            projection_blend=image_node.projection_blend,
            extension=image_node.extension,
            interpolation=image_node.interpolation,
        )


@dataclass(frozen=True)
class Space:
    """Where the maps of a material live.

    - `uniform`: it is the same everywhere;
    - `texture`: it varies only through images that are all looked up alike, so its maps are made
      in the space of those images and tile as they do;
    - `uv`: anything else, baked to the mesh's UV map.

    `groups` are the group nodes that its Principled BSDF lies in, the outermost first.
    """

    kind: Literal["uniform", "texture", "uv"]
    images: tuple[bpy.types.ShaderNodeTexImage, ...] = ()
    groups: tuple[bpy.types.Node, ...] = ()

    @property
    def reads_uv(self) -> bool:
        """Whether the object's UVs are needed to make the maps or to look them up."""
        return self.kind == "uv" or any(_looks_up_uv(each, self.groups) for each in self.images)


def choose_space(
    principled: bpy.types.Node,
    groups: Sequence[bpy.types.Node] = (),
    *,
    painted: bool = False,
) -> Space:
    """The most general space in which the material's maps can be made without loss.

    `groups` are the group nodes that `principled` lies in, the outermost first.
    Where something `painted` on the mesh goes with them, images stay in their own space only if
    that is the mesh's UV map, in which they may not be moved or tiled.
    """
    sockets = [input_socket(principled, identifier) for identifier in SOCKETS.values()]
    images: dict[int, bpy.types.ShaderNodeTexImage] = {}
    groups = tuple(groups)
    for socket in sockets:
        if is_constant(socket, groups):
            continue
        behind = _images_behind(socket, groups)
        if behind is None:
            return Space("uv", groups=groups)
        images.update({node.as_pointer(): node for node in behind})
    if not images:
        return Space("uniform", groups=groups)
    nodes = tuple(images.values())
    looked_up = {_lookup(node, groups) for node in nodes}
    # Beside an image that is clipped there is a surface, which no texture of its own would reach.
    if len(looked_up) > 1 or nodes[0].extension == "CLIP":
        return Space("uv", groups=groups)
    if painted and not _is_on_the_uv_map(nodes[0], groups):
        return Space("uv", groups=groups)
    return Space("texture", nodes, groups)


def looked_up_by(space: Space) -> str | None:
    """The UV map that images are looked up by (empty: each object's own); None if not by it alone.

    What is baked is looked up by the object's own.
    """
    if space.kind == "uv":
        return ""
    if space.images[0].projection != "FLAT":
        return None
    match signature(input_socket(space.images[0], "Vector"), space.groups):
        case ("uv", str(name)):
            return name
    return None


def image_sizes(image: bpy.types.Image) -> set[tuple[int, int]]:
    """The sizes (height, width) of an image's tiles, of which most have one; without those that
    cannot be loaded.
    """
    if image.source == "SEQUENCE":
        return _size_of_first(image)
    of = image.tiles if image.source == "TILED" else (image,)
    return {(each.size[1], each.size[0]) for each in of if min(each.size) > 0}


def image_size(image: bpy.types.Image) -> tuple[int, int]:
    """The size (height, width) of an image, or its largest tile; 0 where it cannot be loaded."""
    return max(image_sizes(image), key=math.prod, default=(0, 0))


def _size_of_first(image: bpy.types.Image) -> set[tuple[int, int]]:
    """That of the file that a sequence is named by.  Asked itself, Blender looks for frame 0, which
    few have.
    """
    path = Path(bpy.path.abspath(image.filepath, library=image.library))
    try:
        size = _size_of_file(path, path.stat().st_mtime_ns)
    except (OSError, ValueError):
        return set()
    return {size}


@functools.lru_cache
def _size_of_file(path: Path, _changed: int) -> tuple[int, int]:
    loaded = imbuf.load(str(path))
    try:
        width, height = loaded.size
    finally:
        loaded.free()
    return height, width


def is_constant(socket: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node] = ()) -> bool:
    """Whether a socket has one value all over: its own, or a plain RGB or Value node's."""
    source = resolve(socket, groups)
    return not source.is_output or source.node.type in ("RGB", "VALUE")


def is_direct(socket: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node] = ()) -> bool:
    """Whether a socket shows an image's color and nothing else, one that can be read as it is."""
    source = resolve(socket, groups)
    if not source.is_output or source.node.type != "TEX_IMAGE" or source.name != "Color":
        return False
    image = source.node.image
    if image is None or image.source not in ("FILE", "GENERATED"):
        return False
    settings = image.colorspace_settings
    return image.is_float or settings.is_data or (settings.name == "sRGB" and _is_rec709())


def _is_rec709() -> bool:
    """Whether the scene's colors are linear Rec.709 and sRGB is what it is elsewhere, as in
    Blender's own OCIO configuration.
    """
    if os.environ.get("OCIO"):
        return False
    red, green = (mathutils.Color(each) for each in ((1, 0, 0), (0, 1, 0)))
    shares = (each.from_scene_linear_to_xyz_d65()[1] for each in (red, green))
    return all(abs(a - b) < 1e-3 for a, b in zip(shares, (0.2126, 0.7152), strict=True))


def _images_behind(
    socket: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node]
) -> tuple[bpy.types.ShaderNodeTexImage, ...] | None:
    """The images that a socket is computed from texel by texel; None if position matters too."""
    found = []

    def walk(at: bpy.types.NodeSocket) -> bool:
        source = resolve(at, groups)
        if not source.is_output:
            return True
        node = known(source.node)
        if node.type == "TEX_IMAGE":
            found.append(node)
            return True
        if node.type == "GROUP":
            inner = (n for s in node.outputs for n in _inside(node, s.identifier))
            return all(n.type in POINTWISE for n in inner) and all(map(walk, node.inputs))
        return node.type in POINTWISE and all(map(walk, node.inputs))

    return tuple(found) if walk(socket) else None


def _inside(group: bpy.types.Node, identifier: str) -> list[bpy.types.Node]:
    """The nodes inside a group behind one of its outputs, groups within it left out."""
    if group.node_tree is None:
        return []
    ends = [n for n in group.node_tree.nodes if n.type == "GROUP_OUTPUT" and n.is_active_output]
    return [
        node
        for end in ends
        for node, _ in upstream(input_socket(end, identifier))
        if node.type != "GROUP"
    ]


def _lookup(
    node: bpy.types.ShaderNodeTexImage, groups: Sequence[bpy.types.Node]
) -> tuple[object, ...]:
    blend = node.projection_blend if node.projection == "BOX" else 0.0
    return (signature(input_socket(node, "Vector"), groups), node.projection, blend, node.extension)


def _is_on_the_uv_map(node: bpy.types.ShaderNodeTexImage, groups: Sequence[bpy.types.Node]) -> bool:
    looked_up_by = signature(input_socket(node, "Vector"), groups)
    return node.projection == "FLAT" and looked_up_by == ("uv", "")


def _looks_up_uv(node: bpy.types.ShaderNodeTexImage, groups: Sequence[bpy.types.Node]) -> bool:
    vector = input_socket(node, "Vector")
    if not resolve(vector, groups).is_output:
        return True
    return any(
        each.type == "UVMAP" or (each.type == "TEX_COORD" and output == "UV")
        for each, output in upstream(vector, groups)
    )
