"""The surface that is looked at, among all around it, in a scene that is gone afterwards."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np
from numpy.typing import NDArray

from ..nodes.trace import input_socket, upstream
from ..reading.cycles import baking_scene
from ..reading.passing import discard
from .collect import Around
from .parts import Part

__all__ = ("BAKED", "NORMAL", "UV_MAP", "glows", "smoothed", "standing")

Array = NDArray[np.float32]

UV_MAP, NORMAL = "tvbrdf layout", "tvbrdf normal"
"""Of the object: its layout, and the attribute that holds its normals in the world."""

_USUAL_UV_MAP = "UVMap"
_EMISSION = {
    "EMISSION": ("Strength", "Color"),
    "BSDF_PRINCIPLED": ("Emission Strength", "Emission Color"),
}

BAKED = 0.25
"""By this what is baked is moved up, so that what was not baked, which is 0, is told apart."""


@contextmanager
def standing(
    parts: Sequence[Part],
    around: Sequence[Around],
    uv: Array,
    frame: int = 1,
    *,
    glowing: bool = False,
) -> Iterator[tuple[bpy.types.Scene, bpy.types.Object, bpy.types.Material]]:
    """A baking scene in which the parts' triangles, laid out at `uv` [T, 3, 2], stand as one object
    of one material among all that is around, gray but for what glows, if that is to.
    """
    corners = np.concatenate([part.faces.corners for part in parts])
    normals = np.concatenate([part.normals for part in parts])
    with ExitStack() as stack:
        scene = stack.enter_context(baking_scene(frame))
        material = bpy.data.materials.new("tvbrdf look")
        stack.callback(bpy.data.materials.remove, material)
        if bpy.app.version < (5, 0):
            material.use_nodes = True
        mesh = stack.enter_context(_mesh(corners.reshape(-1, 3), np.arange(corners.size // 3)))
        mesh.materials.append(material)
        mesh.uv_layers.new(name=UV_MAP).data.foreach_set("uv", uv.ravel())
        attribute = mesh.attributes.new(NORMAL, "FLOAT_VECTOR", "CORNER")
        attribute.data.foreach_set("vector", normals.ravel())
        obj = stack.enter_context(_placed(scene, mesh))
        for other in around:
            stands = stack.enter_context(_mesh(other.vertices, other.triangles.ravel()))
            if glowing and glows(other):
                _glow(stands, other)
            for matrix in other.matrices:
                stack.enter_context(_placed(scene, stands)).matrix_world = matrix
        yield scene, obj, material


def glows(other: Around) -> bool:
    """Whether any of what stands around emits light."""
    return any(map(_emits, other.materials))


def _glow(mesh: bpy.types.Mesh, other: Around) -> None:
    """Gives the mesh of what stands around those of its materials that emit light."""
    for each in other.materials:
        mesh.materials.append(each if _emits(each) else None)
    mesh.polygons.foreach_set("material_index", other.slots.astype(np.int32))
    if other.uv is not None:
        mesh.uv_layers.new(name=_USUAL_UV_MAP).data.foreach_set("uv", other.uv.ravel())


def _emits(material: bpy.types.Material | None) -> bool:
    tree = material and material.node_tree
    output = tree and tree.get_output_node("CYCLES")
    for node, _ in upstream(output.inputs["Surface"]) if output else ():
        sockets = [input_socket(node, name) for name in _EMISSION.get(node.type, ())]
        if sockets and all(map(_may_be_above_0, sockets)):
            return True
    return False


def _may_be_above_0(socket: bpy.types.NodeSocket) -> bool:
    if socket.is_linked:
        return True
    return bool(np.max(np.atleast_1d(socket.default_value)[:3]) > 0)


def smoothed(values: Array, there: NDArray[np.bool_]) -> Array:
    """The means of what is `there` in squares of three texels a side: few rays are noisy."""
    count = there.astype(np.float32)
    weighted = np.concatenate((values * count[..., None], count[..., None]), 2)
    for axis in (0, 1):
        middle = np.moveaxis(weighted, axis, 0)
        total = middle.copy()
        total[1:] += middle[:-1]
        total[:-1] += middle[1:]
        weighted = np.moveaxis(total, 0, axis)
    return weighted[..., :-1] / np.maximum(weighted[..., -1:], 1)


@contextmanager
def _mesh(vertices: Array, corners: NDArray[np.integer]) -> Iterator[bpy.types.Mesh]:
    """A mesh of triangles, `corners` of which count vertices [V, 3]."""
    mesh = bpy.data.meshes.new("tvbrdf look")
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
        discard(mesh)


@contextmanager
def _placed(scene: bpy.types.Scene, mesh: bpy.types.Mesh) -> Iterator[bpy.types.Object]:
    obj = bpy.data.objects.new("tvbrdf look", mesh)
    try:
        scene.collection.objects.link(obj)
        yield obj
    finally:
        bpy.data.objects.remove(obj)
