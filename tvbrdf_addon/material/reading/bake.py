"""Bakes node sockets to maps with Cycles, in a scene of its own that is gone afterwards."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import bpy
import numpy as np

from ....model_runtime.resampling import resize
from ...known import image_texture, known, tree_of
from ..nodes.groups import shown_outside
from ..nodes.surface import Place, find_principled
from ..nodes.trace import resolve, upstream
from .cycles import Baker, baking_scene
from .evaluated import Evaluated
from .pixels import Array, require_memory
from .space import image_sizes
from .standin import object_like, scene_like
from .tiles import Tile, Tiles

__all__ = ("Target", "bake_sockets")

# What Cycles and its copies need for a texel of a bake.
_BYTES_PER_TEXEL = 100

# Nodes whose value is a mean over random rays, of which one sample has few.
_NOISY = ("BEVEL", "AMBIENT_OCCLUSION")
# Samples of a texel that has to be averaged, and of all texels together.
_SAMPLES, _MOST_SAMPLES = 16, 1 << 25
# Mean error of values between four texels, told by these, from which a pattern is finer than they.
_FINE = 0.02


@dataclass(frozen=True)
class Target:
    """What is baked to: the UV map of an object that has `material`, or (None) plain squares.

    On plain squares image textures are looked up texel by texel, whatever feeds their Vector.
    `scene` is the artist's, whose attributes the material may read.
    """

    material: bpy.types.Material
    look: Evaluated | None = None
    uv_map: str = "UVMap"
    tiles: Tiles = field(default_factory=Tiles)
    scene: bpy.types.Scene | None = None


def bake_sockets(
    copy: bpy.types.Material,
    identifiers: Sequence[str],
    target: Target,
    *,
    size: tuple[int, int],
    frame: int,
    shape: tuple[int, int] | None = None,
) -> tuple[dict[str, Array], Array]:
    """The values of Principled sockets, by identifier, as maps, and the share covered by faces.

    `copy` is a copy of the material that may be changed, and so may the groups that its Principled
    BSDF lies in.  `size` is the (height, width) at which
    each tile is baked, `shape` that to which it is then resampled, if it is another.  Colors are
    [H, W, 3], numbers [H, W] for all tiles together; the coverage [H, W] is 1 where a face lies.
    One sample at the texel's center, or the mean of several where what is baked is noisy or finer
    than a texel; the same input gives the same maps.  Of a target's object faces must have been
    required (`unwrap.require_faces`).  Raises `MaterialError` where Cycles fails.
    """
    require_memory(size, _BYTES_PER_TEXEL)
    place = find_principled(copy)
    sockets = [place.input(each) for each in identifiers]
    behind = [pair for socket in sockets for pair in upstream(socket, place.groups)]
    with ExitStack() as stack:
        scene = stack.enter_context(baking_scene(frame))
        scene_like(scene, target.scene, behind)
        obj = stack.enter_context(_object(scene, copy, target, behind))
        emission = _emission(place)
        node = _image_to_bake_to(place, size, target)
        baker = Baker(scene, obj, node, target.uv_map, margin=max(8, max(size) // 32))
        sampled = _Sampled.of(baker, size, behind, flat=target.look is None)

        def kept(pixels: Array) -> Array:
            return resize(pixels, shape or size)

        tiles = target.tiles.used
        emission.inputs["Color"].default_value = (1, 1, 1, 1)
        inside = {tile: baker.texels(tile, size, margin=0)[..., 0] for tile in tiles}
        maps: dict[str, dict[Tile, Array]] = {each: {} for each in identifiers}
        for group in _passes(sockets):
            _emit(emission, group, place.groups)
            for tile in tiles:
                pixels = sampled.values(tile, inside[tile])
                if group[0].type == "RGBA":
                    maps[group[0].identifier][tile] = kept(pixels)
                else:
                    for i, socket in enumerate(group):
                        maps[socket.identifier][tile] = kept(pixels[..., i])
    together = target.tiles.put_together
    coverage = together({tile: kept(each) for tile, each in inside.items()}, beside=0.0)
    return {each: together(parts) for each, parts in maps.items()}, coverage


@dataclass(frozen=True)
class _Sampled:
    """How many looks a texel of a bake gets: `samples` where what is baked is `noisy`, or where it
    is `patterned` and finer than a texel; else one.
    """

    baker: Baker
    size: tuple[int, int]
    samples: int
    noisy: bool
    patterned: bool

    @classmethod
    def of(
        cls,
        baker: Baker,
        size: tuple[int, int],
        behind: Sequence[tuple[bpy.types.Node, str]],
        *,
        flat: bool,
    ) -> _Sampled:
        """For what lies `behind` the sockets; on `flat` squares images are looked up by texel."""
        return cls(
            baker,
            size,
            samples=max(4, min(_SAMPLES, _MOST_SAMPLES // (size[0] * size[1]))),
            noisy=any(node.type in _NOISY for node, _ in behind),
            patterned=not flat and any(_is_pattern(node) for node, _ in behind),
        )

    def values(self, tile: Tile, inside: Array) -> Array:
        """What is emitted on a tile, of which faces lie `inside`."""
        size, baker = self.size, self.baker
        if self.noisy:
            return baker.mean(tile, size, self.samples)
        pixels = baker.texels(tile, size)
        if not self.patterned or size[0] % 4 or size[1] % 4:
            return pixels
        between = baker.texels(tile, (size[0] // 4, size[1] // 4))
        if _is_finer(pixels, between, inside):
            return baker.mean(tile, size, self.samples)
        return pixels


def _emission(place: Place) -> bpy.types.Node:
    """A node whose color is all that the material at `place` shows from now on."""
    tree, output = place.trees[0], place.output
    output.target = "CYCLES"  # it may be one for EEVEE
    alphas = _used_alphas(place)
    for side in ("Volume", "Displacement"):
        _unlink(tree, output.inputs[side])
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(emission.outputs["Emission"], output.inputs["Surface"])
    _keep_used(tree, alphas, emission.inputs["Strength"])
    return emission


def _image_to_bake_to(
    place: Place, size: tuple[int, int], target: Target
) -> bpy.types.ShaderNodeTexImage:
    """The active node, whose image Cycles fills."""
    tree = place.trees[0]
    node = image_texture(tree.nodes.new("ShaderNodeTexImage"))
    tree.nodes.active = node
    if target.look is None:
        for each in place.trees:
            _look_up_texels(each, size, target.tiles, node)
    return node


def _is_pattern(node: bpy.types.Node) -> bool:
    return node.type.startswith("TEX_") and node.type != "TEX_COORD"


def _is_finer(pixels: Array, between: Array, inside: Array) -> bool:
    """Whether a pattern is finer than its texels: `between` every fourth of which, across and
    down, it was looked at again, and is not what the four around tell.
    """

    def mean_around(values: Array) -> Array:
        first, *others = (values[1 + i :: 4, 1 + j :: 4] for i in (0, 1) for j in (0, 1))
        return sum(others, start=first) / 4

    whole = mean_around(inside) == 1
    error = np.abs(mean_around(pixels) - between)[whole]
    return bool(error.size and error.mean() > _FINE)


def _used_alphas(place: Place) -> list[bpy.types.NodeSocket]:
    """The outputs through which the material uses alphas of images: Cycles then takes the images'
    colors without them.
    """
    found = [
        node.outputs["Alpha"]
        for node, name in upstream(place.output.inputs["Surface"])
        if node.type == "TEX_IMAGE" and name == "Alpha" and node.id_data in place.trees
    ]
    alpha = resolve(place.input("Alpha"), place.groups)
    if alpha.is_output and alpha.node.type == "GROUP":
        found.append(alpha)
    return [shown_outside(socket, place.groups) for socket in found]


def _keep_used(
    tree: bpy.types.NodeTree,
    sockets: Sequence[bpy.types.NodeSocket],
    strength: bpy.types.NodeSocket,
) -> None:
    """Lets `strength`, which stays 1, seem to depend on `sockets`."""
    for socket in sockets:
        one = tree.nodes.new("ShaderNodeMath")
        one.operation, one.use_clamp = "MAXIMUM", True
        one.inputs[0].default_value = 1.0
        if strength.is_linked:
            tree.links.new(known(known(strength.links)[0].from_socket), one.inputs[0])
        tree.links.new(socket, one.inputs[1])
        tree.links.new(one.outputs[0], strength)


def _passes(sockets: Sequence[bpy.types.NodeSocket]) -> Iterator[list[bpy.types.NodeSocket]]:
    """A color fills a pass; three numbers share one."""
    numbers = []
    for socket in sockets:
        if socket.type == "RGBA":
            yield [socket]
        else:
            numbers.append(socket)
    for start in range(0, len(numbers), 3):
        yield numbers[start : start + 3]


def _emit(
    emission: bpy.types.Node,
    group: list[bpy.types.NodeSocket],
    groups: Sequence[bpy.types.Node],
) -> None:
    tree = tree_of(emission)
    sources = [shown_outside(known(known(socket.links)[0].from_socket), groups) for socket in group]
    if group[0].type == "RGBA":
        tree.links.new(sources[0], emission.inputs["Color"])
        return
    combined = tree.nodes.new("ShaderNodeCombineXYZ")
    for source, channel in zip(sources, combined.inputs, strict=False):
        tree.links.new(source, channel)
    tree.links.new(combined.outputs["Vector"], emission.inputs["Color"])


def _look_up_texels(
    tree: bpy.types.NodeTree, size: tuple[int, int], tiles: Tiles, ours: bpy.types.Node
) -> None:
    for node in tree.nodes:
        if node.type == "TEX_IMAGE" and node != ours:
            _unlink(tree, node.inputs["Vector"])
            node.projection = "FLAT"
            image = node.image
            # Beside tiles, an image without any goes on as it does.
            if tiles.are_one or (image and image.source == "TILED"):
                node.extension = "EXTEND"
            # Baking samples a thousandth of a texel beside the center.
            same = image and image_sizes(image) == {size}
            node.interpolation = "Closest" if same else "Linear"


def _unlink(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket) -> None:
    for link in list(known(socket.links)):
        tree.links.remove(link)


@contextmanager
def _object(
    scene: bpy.types.Scene,
    copy: bpy.types.Material,
    target: Target,
    behind: Sequence[tuple[bpy.types.Node, str]],
) -> Iterator[bpy.types.Object]:
    """The target's stand-in: the object as it was seen, with `copy` where it has the material."""
    with ExitStack() as stack:
        if target.look is None:
            mesh = _squares(target.uv_map, target.tiles)
            stack.callback(bpy.data.meshes.remove, mesh)
            mesh.materials.append(copy)
            obj = bpy.data.objects.new("tvbrdf bake", mesh)
            stack.callback(bpy.data.objects.remove, obj)
        else:
            blank = bpy.data.materials.new("tvbrdf blank")
            stack.callback(bpy.data.materials.remove, blank)
            materials = [
                copy if each == target.material else blank for each in target.look.mesh.materials
            ]
            obj = stack.enter_context(object_like(target.look, materials, behind))
        scene.collection.objects.link(obj)
        yield obj


def _squares(uv_map: str, tiles: Tiles) -> bpy.types.Mesh:
    """A unit square for every tile, where it lies in UV space."""
    mesh = bpy.data.meshes.new("tvbrdf bake")
    square = ((0, 0), (1, 0), (1, 1), (0, 1))
    corners = [(u + x, v + y) for u, v in tiles.used for x, y in square]
    faces = [range(first, first + 4) for first in range(0, len(corners), 4)]
    mesh.from_pydata([(x, y, 0) for x, y in corners], [], faces)
    layer = mesh.uv_layers.new(name=uv_map)
    layer.data.foreach_set("uv", np.array(corners, np.float32).ravel())
    return mesh
