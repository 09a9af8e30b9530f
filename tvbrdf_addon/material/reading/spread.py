"""How textures lie on the objects that show them: by which UV map, and how large."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ...known import known
from ..nodes.trace import input_socket, is_animated, resolve
from .evaluated import distinct, in_view
from .space import Space
from .tiles import Tiles
from .unwrap import active_uv_map, triangles

__all__ = ("in_world", "texture_side", "uv_mapping")

Array = NDArray[np.float64]


def texture_side(
    material: bpy.types.Material,
    space: Space,
    tiles: Tiles,
    size: tuple[int, int],
    objects: Iterable[bpy.types.Object],
) -> float:
    """The length in the world of the longer side of the textures of `material`, of a `size` in
    texels, on the objects that show it, on average by area; where it is unknown how they lie, as
    if they covered the surface once.  1 without a surface.
    """
    found = uv_mapping(space)
    world = texture = 0.0
    for obj in distinct(each for each in objects if each.type == "MESH"):
        with _shown(obj) as (mesh, materials, matrix):
            uv_map = (found and found[0]) or active_uv_map(mesh)
            if uv_map is None or uv_map not in mesh.uv_layers:
                continue
            corners, uv = triangles(mesh, [each == material for each in materials], uv_map)
        world += float(_areas(corners @ matrix[:3, :3].T + matrix[:3, 3]).sum())
        texture += float(_areas(np.pad(uv, ((0, 0), (0, 0), (0, 1)))).sum())  # in a plane
    scale = abs(float(np.linalg.det(found[1]))) if found is not None else 0.0
    shown = texture * scale / (tiles.columns * tiles.rows)
    area = world / shown if shown > 0 else world
    return math.sqrt(area * max(size) / min(size)) if area > 0 else 1.0


@contextmanager
def _shown(
    obj: bpy.types.Object,
) -> Iterator[tuple[bpy.types.Mesh, list[bpy.types.Material | None], Array]]:
    """The mesh as the view shows it, its materials, and where it stands: [4, 4].

    What nothing moves or changes is as it says itself: to evaluate a scene of thousands takes long.
    """
    if _is_plain(obj):
        assert isinstance(obj.data, bpy.types.Mesh)
        slots = [slot.material for slot in obj.material_slots]
        yield obj.data, slots, np.array(obj.matrix_basis, np.float64)
        return
    depsgraph = bpy.context.evaluated_depsgraph_get()
    with in_view(obj, depsgraph) as (mesh, materials):
        yield mesh, materials, np.array(obj.evaluated_get(depsgraph).matrix_world, np.float64)


def _is_plain(obj: bpy.types.Object) -> bool:
    mesh = obj.data
    assert isinstance(mesh, bpy.types.Mesh)
    changed = (mesh.shape_keys, mesh.animation_data, *obj.modifiers, *obj.constraints)
    moved = (obj.parent, obj.animation_data, obj.rigid_body)
    return obj.mode == "OBJECT" and not any(each is not None for each in (*changed, *moved))


def in_world(
    corners: NDArray[np.floating], obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph
) -> Array:
    """Points [..., 3] of an object in the world."""
    world = np.array(obj.evaluated_get(depsgraph).matrix_world, np.float64)
    return corners @ world[:3, :3].T + world[:3, 3]


def _areas(corners: NDArray[np.floating]) -> Array:
    """Of triangles [T, 3, 3]."""
    a, b = np.moveaxis(np.diff(corners.astype(np.float64), axis=1), 1, 0)
    return np.linalg.norm(np.cross(a, b), axis=-1) / 2


def uv_mapping(space: Space) -> tuple[str, Array] | None:
    """The UV map that textures are looked up by (empty: each object's own), and the linear part
    [2, 2] of what turns it into their coordinates; None where they are looked up otherwise.
    """
    straight = mathutils.Matrix.Identity(3)
    if space.kind != "texture":
        return "", np.eye(2)
    node = space.images[0]
    flat = node.projection == "FLAT"
    found = _through(input_socket(node, "Vector"), straight, space.groups) if flat else None
    if found is None:
        return None
    uv_map, matrix = found
    return uv_map, np.array(matrix)[:2, :2]


def _through(
    vector: bpy.types.NodeSocket, after: mathutils.Matrix, groups: Sequence[bpy.types.Node]
) -> tuple[str, mathutils.Matrix] | None:
    """The UV map behind an image's Vector, and all Mapping nodes between as one matrix."""
    source = resolve(vector, groups)
    if not source.is_output:
        return ("", after) if source.node.type == "TEX_IMAGE" else None
    node = known(source.node)
    if node.type == "UVMAP" and not node.from_instancer:
        return node.uv_map, after
    if node.type == "TEX_COORD" and source.name == "UV" and not node.from_instancer:
        return "", after
    if node.type != "MAPPING" or is_animated(node):
        return None
    rotation, scale = (resolve(node.inputs[name], groups) for name in ("Rotation", "Scale"))
    if rotation.is_output or scale.is_output or node.vector_type == "NORMAL":
        return None
    turned = mathutils.Euler(rotation.default_value).to_matrix()
    matrix = turned @ mathutils.Matrix.Diagonal(scale.default_value)
    if node.vector_type == "TEXTURE":
        if matrix.determinant() == 0:
            return None
        matrix = matrix.inverted()
    return _through(node.inputs["Vector"], after @ matrix, groups)
