"""What lies in crevices, on edges and under the sky, as Cycles sees it: three bakes in one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ...known import image_texture, known
from ..reading.cycles import Baker, baking_scene
from .collect import Around
from .parts import Part

__all__ = ("Shelter", "shelter")

Array = NDArray[np.float32]

_UV_MAP, _NORMAL = "tvbrdf layout", "tvbrdf normal"
# Of the size of the objects: how far crevices and edges reach; of all together: the sky's height.
_CREVICE, _EDGE, _SKY = 0.1, 0.02, 3.0
# Rays of a texel: samples of the bake times those of each node.
_SAMPLES, _RAYS = 2, 8
# What is baked is moved up by this, so that what was not baked, which is 0, is told apart.
_BAKED = 0.25


@dataclass(frozen=True)
class Shelter:
    """Maps [H, W], 0 to 1: `ao` 1 in the open and 0 in crevices, `edge` 0 on what is flat and 1 on
    edges, `sky` how much of it is seen; and where these were `baked`.
    """

    ao: Array
    edge: Array
    sky: Array
    baked: NDArray[np.bool_]


def shelter(
    parts: Sequence[Part], around: Sequence[Around], uv: Array, size: tuple[int, int]
) -> Shelter:
    """What the parts' triangles, laid out at `uv` [T, 3, 2], see of themselves and of all around,
    at the centers of a map's texels.  Raises `MaterialError` where Cycles fails.
    """
    corners = np.concatenate([part.faces.corners for part in parts])
    normals = np.concatenate([part.normals for part in parts])
    each = [np.linalg.norm(np.ptp(part.faces.corners, (0, 1))) for part in parts]
    single, whole = float(np.median(each)), float(np.linalg.norm(np.ptp(corners, (0, 1))))
    with ExitStack() as stack:
        scene = stack.enter_context(baking_scene(1))
        material = bpy.data.materials.new("tvbrdf shelter")
        stack.callback(bpy.data.materials.remove, material)
        node = _emit(material, _CREVICE * single, _EDGE * single, _SKY * whole)
        mesh = stack.enter_context(_mesh(corners.reshape(-1, 3), np.arange(corners.size // 3)))
        mesh.materials.append(material)
        mesh.uv_layers.new(name=_UV_MAP).data.foreach_set("uv", uv.ravel())
        attribute = mesh.attributes.new(_NORMAL, "FLOAT_VECTOR", "CORNER")
        attribute.data.foreach_set("vector", normals.ravel())
        obj = stack.enter_context(_placed(scene, mesh))
        for other in around:
            stands = stack.enter_context(_mesh(other.vertices, other.triangles.ravel()))
            for matrix in other.matrices:
                stack.enter_context(_placed(scene, stands)).matrix_world = matrix
        baked = Baker(scene, obj, node, _UV_MAP, 0).texels((0, 0), size, samples=_SAMPLES)
    there = baked.any(2)
    values = _smoothed(((baked - _BAKED) / (1 - _BAKED)).clip(0, 1), there)
    # Of the rays into an edge of a right angle half meet the other side at once.
    return Shelter(values[..., 0], (2 - 2 * values[..., 1]).clip(0, 1), values[..., 2], there)


def _smoothed(values: Array, there: NDArray[np.bool_]) -> Array:
    """The means of what is `there` in squares of three texels a side: few rays are noisy."""
    count = there.astype(np.float32)
    weighted = np.concatenate((values * count[..., None], count[..., None]), 2)
    for axis in (0, 1):
        middle = np.moveaxis(weighted, axis, 0)
        total = middle.copy()
        total[1:] += middle[:-1]
        total[:-1] += middle[1:]
        weighted = np.moveaxis(total, 0, axis)
    return weighted[..., :3] / np.maximum(weighted[..., 3:], 1)


@contextmanager
def _mesh(vertices: Array, corners: NDArray[np.integer]) -> Iterator[bpy.types.Mesh]:
    """A mesh of triangles, `corners` of which count vertices [V, 3]."""
    mesh = bpy.data.meshes.new("tvbrdf shelter")
    try:
        mesh.vertices.add(len(vertices))
        mesh.vertices.foreach_set("co", vertices.ravel())
        mesh.loops.add(len(corners))
        mesh.loops.foreach_set("vertex_index", corners.astype(np.int32))
        mesh.polygons.add(len(corners) // 3)
        mesh.polygons.foreach_set("loop_start", np.arange(0, len(corners), 3, np.int32))
        mesh.update(calc_edges=True)
        yield mesh
    finally:
        bpy.data.meshes.remove(mesh)


@contextmanager
def _placed(scene: bpy.types.Scene, mesh: bpy.types.Mesh) -> Iterator[bpy.types.Object]:
    obj = bpy.data.objects.new("tvbrdf shelter", mesh)
    try:
        scene.collection.objects.link(obj)
        yield obj
    finally:
        bpy.data.objects.remove(obj)


def _emit(
    material: bpy.types.Material, crevice: float, edge: float, sky: float
) -> bpy.types.ShaderNodeTexImage:
    """Lets a material emit what three nodes see as red, green and blue; its image to bake to."""
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = known(material.node_tree)
    tree.nodes.clear()

    def occlusion(distance: float, **settings: bool) -> bpy.types.Node:
        node = tree.nodes.new("ShaderNodeAmbientOcclusion")
        node.samples = _RAYS
        node.inputs["Distance"].default_value = distance
        for name, value in settings.items():
            setattr(node, name, value)
        return node

    normal = tree.nodes.new("ShaderNodeAttribute")
    normal.attribute_name = _NORMAL
    up = tree.nodes.new("ShaderNodeCombineXYZ")
    up.inputs["Z"].default_value = 1.0
    combined = tree.nodes.new("ShaderNodeCombineXYZ")
    for socket, node, facing in zip(
        combined.inputs,
        (occlusion(crevice), occlusion(edge, inside=True, only_local=True), occlusion(sky)),
        (normal.outputs["Vector"], normal.outputs["Vector"], up.outputs[0]),
        strict=True,
    ):
        tree.links.new(facing, node.inputs["Normal"])
        tree.links.new(node.outputs["AO"], socket)
    moved = tree.nodes.new("ShaderNodeVectorMath")
    moved.operation = "MULTIPLY_ADD"
    moved.inputs[1].default_value = (1 - _BAKED,) * 3
    moved.inputs[2].default_value = (_BAKED,) * 3
    emission = tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(combined.outputs[0], moved.inputs[0])
    tree.links.new(moved.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    image = image_texture(tree.nodes.new("ShaderNodeTexImage"))
    tree.nodes.active = image
    return image
