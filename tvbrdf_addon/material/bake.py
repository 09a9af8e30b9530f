"""Bakes node sockets to maps with Cycles, in a scene of its own that is gone afterwards."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import bpy
import numpy as np

from ..errors import MaterialError
from .pixels import Array, image_pixels
from .trace import find_principled, input_socket
from .unwrap import plain_mesh

__all__ = ("Target", "bake_sockets")


@dataclass(frozen=True)
class Target:
    """What is baked to: the UV map of an object that has `material`, or (None) the unit square.

    On the unit square image textures are looked up texel by texel, whatever feeds their Vector.
    """

    material: bpy.types.Material
    obj: bpy.types.Object | None = None
    uv_map: str = "UVMap"


def bake_sockets(
    copy: bpy.types.Material,
    identifiers: Sequence[str],
    target: Target,
    *,
    size: tuple[int, int],
    frame: int,
) -> tuple[dict[str, Array], Array]:
    """The values of Principled sockets, by identifier, as maps, and the share covered by faces.

    `copy` is a copy of the material that may be changed.  `size` is (height, width).  Colours are
    [H, W, 3], numbers [H, W]; the coverage [H, W] is 1 where a face lies.  One sample at
    the texel's centre, so the same input gives the same maps.  Raises `MaterialError` where Cycles
    fails.
    """
    tree = copy.node_tree
    output, principled = find_principled(copy)
    sockets = [input_socket(principled, each) for each in identifiers]
    with ExitStack() as stack:
        scene = stack.enter_context(_scene(frame))
        obj = stack.enter_context(_object(scene, copy, target))
        image = stack.enter_context(_image(size))
        for side in ("Volume", "Displacement"):
            _unlink(tree, output.inputs[side])
        emission = tree.nodes.new("ShaderNodeEmission")
        tree.links.new(emission.outputs["Emission"], output.inputs["Surface"])
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        tree.nodes.active = node
        if target.obj is None:
            _look_up_texels(tree, size)

        def bake(margin: int) -> Array:
            _bake(scene, obj, target.uv_map, margin)
            return image_pixels(image)[..., :3]

        emission.inputs["Color"].default_value = (1, 1, 1, 1)
        coverage = bake(0)[..., 0]
        margin = max(8, max(size) // 32)
        maps: dict[str, Array] = {}
        for group in _passes(sockets):
            _emit(tree, emission, group)
            pixels = bake(margin)
            if group[0].type == "RGBA":
                maps[group[0].identifier] = pixels.copy()
            else:
                maps.update({s.identifier: pixels[..., i].copy() for i, s in enumerate(group)})
        return maps, coverage


def _passes(sockets: Sequence[bpy.types.NodeSocket]) -> Iterator[list[bpy.types.NodeSocket]]:
    """A colour fills a pass; three numbers share one."""
    numbers = []
    for socket in sockets:
        if socket.type == "RGBA":
            yield [socket]
        else:
            numbers.append(socket)
    for start in range(0, len(numbers), 3):
        yield numbers[start : start + 3]


def _emit(
    tree: bpy.types.NodeTree, emission: bpy.types.Node, group: list[bpy.types.NodeSocket]
) -> None:
    if group[0].type == "RGBA":
        tree.links.new(group[0].links[0].from_socket, emission.inputs["Color"])
        return
    combined = tree.nodes.new("ShaderNodeCombineXYZ")
    for socket, channel in zip(group, combined.inputs, strict=False):
        tree.links.new(socket.links[0].from_socket, channel)
    tree.links.new(combined.outputs["Vector"], emission.inputs["Color"])


def _look_up_texels(tree: bpy.types.NodeTree, size: tuple[int, int]) -> None:
    for node in tree.nodes:
        if node.type == "TEX_IMAGE":
            _unlink(tree, node.inputs["Vector"])
            node.projection = "FLAT"
            node.extension = "EXTEND"
            # Baking samples a thousandth of a texel beside the centre.
            same = node.image and tuple(node.image.size) == size[::-1]
            node.interpolation = "Closest" if same else "Linear"


def _unlink(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket) -> None:
    for link in list(socket.links):
        tree.links.remove(link)


@contextmanager
def _scene(frame: int) -> Iterator[bpy.types.Scene]:
    scene = bpy.data.scenes.new("tvbrdf bake")
    try:
        if not hasattr(scene, "cycles"):
            raise MaterialError(
                "This material has to be baked, and Cycles is turned off.",
                "Enable Cycles Render Engine in Preferences > Add-ons.",
            )
        scene.render.engine = "CYCLES"
        scene.cycles.device = "CPU"
        scene.cycles.samples = 1
        scene.cycles.use_adaptive_sampling = False
        scene.cycles.use_denoising = False
        scene.render.bake.view_from = "ABOVE_SURFACE"
        scene.frame_current = frame
        yield scene
    finally:
        # Not scenes.remove, which crashes Blender (4.3) where there is no window: --command.
        bpy.data.batch_remove((scene,))


@contextmanager
def _object(
    scene: bpy.types.Scene, copy: bpy.types.Material, target: Target
) -> Iterator[bpy.types.Object]:
    """The target's stand-in: the object again, with `copy` where it has the material."""
    with ExitStack() as stack:
        blank = bpy.data.materials.new("tvbrdf blank")
        stack.callback(bpy.data.materials.remove, blank)
        if target.obj is None:
            mesh = _unit_square(target.uv_map)
            stack.callback(bpy.data.meshes.remove, mesh)
            mesh.materials.append(copy)
            obj = bpy.data.objects.new("tvbrdf bake", mesh)
        else:
            mesh = stack.enter_context(plain_mesh(target.obj))
            obj = target.obj.copy()
            obj.data = mesh
        stack.callback(bpy.data.objects.remove, obj)
        if target.obj is not None:
            for slot in obj.material_slots:
                ours = slot.material == target.material
                slot.link = "OBJECT"
                slot.material = copy if ours else blank
        obj.hide_render = obj.hide_viewport = False
        scene.collection.objects.link(obj)
        yield obj


def _unit_square(uv_map: str) -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new("tvbrdf bake")
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    mesh.from_pydata([(x, y, 0) for x, y in corners], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name=uv_map)
    layer.data.foreach_set("uv", np.array(corners, np.float32).ravel())
    return mesh


@contextmanager
def _image(size: tuple[int, int]) -> Iterator[bpy.types.Image]:
    height, width = size
    image = bpy.data.images.new(
        "tvbrdf bake", width, height, alpha=False, float_buffer=True, is_data=True
    )
    try:
        yield image
    finally:
        bpy.data.images.remove(image)


def _bake(scene: bpy.types.Scene, obj: bpy.types.Object, uv_map: str, margin: int) -> None:
    view_layer = scene.view_layers[0]
    objects = [obj]
    try:
        with bpy.context.temp_override(
            scene=scene,
            view_layer=view_layer,
            object=obj,
            active_object=obj,
            selected_objects=objects,
            selected_editable_objects=objects,
        ):
            bpy.ops.object.bake(
                type="EMIT",
                target="IMAGE_TEXTURES",
                save_mode="INTERNAL",
                margin=margin,
                margin_type="EXTEND",
                use_clear=True,
                use_selected_to_active=False,
                use_cage=False,
                uv_layer=uv_map,
            )
    except RuntimeError as error:
        raise MaterialError(
            f"Cycles could not bake the material: {str(error).strip()}",
            "Try Object > Convert > Mesh on a copy of the object, or free memory.",
        ) from error
