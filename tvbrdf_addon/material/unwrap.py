"""Whether a mesh is unwrapped so that it can be baked to."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import MaterialError

__all__ = ("active_uv_map", "check_unwrapped", "overlaps", "plain_mesh", "triangles")

Array = NDArray[np.float32]


def active_uv_map(mesh: bpy.types.Mesh) -> str | None:
    """The UV map that is used for rendering; None where there is none."""
    layers = mesh.uv_layers
    return next((each.name for each in layers if each.active_render), None)


def check_unwrapped(
    obj: bpy.types.Object, material: bpy.types.Material, uv_map: str, size: int
) -> None:
    """Raises `MaterialError` where the material's faces leave the unit square by half a texel."""
    with plain_mesh(obj) as mesh:
        _, uv = triangles(obj, mesh, material, uv_map)
    if not len(uv):
        raise MaterialError(
            f"No face of “{obj.name}” shows “{material.name}”.",
            "Assign the material to some faces, or select another object.",
        )
    if not np.isfinite(uv).all() or uv.min() < -0.5 / size or uv.max() > 1 + 0.5 / size:
        raise MaterialError(
            f"The UV map “{uv_map}” of “{obj.name}” reaches outside the square from 0 to 1, and "
            f"“{material.name}” has to be baked.",
            "Give the mesh a second UV map that fits (UV > Smart UV Project), mark it for "
            "rendering, and name the old one in UV Map nodes.",
        )


def overlaps(
    obj: bpy.types.Object,
    material: bpy.types.Material,
    uv_map: str,
    coverage: Array,
    tiles: int = 1,
) -> bool:
    """Whether the material's faces cover more of UV space than they leave marked in `coverage`,
    which shows so many `tiles` of it.

    A tenth is allowed for the texels that borders cut.
    """
    with plain_mesh(obj) as mesh:
        _, uv = triangles(obj, mesh, material, uv_map)
    (x1, y1), (x2, y2) = (np.moveaxis(uv[:, i] - uv[:, 0], -1, 0) for i in (1, 2))
    area = np.abs(x1 * y2 - x2 * y1) / 2
    return bool(area.sum() > 1.1 * tiles * np.count_nonzero(coverage) / coverage.size + 1e-3)


@contextmanager
def plain_mesh(obj: bpy.types.Object) -> Iterator[bpy.types.Mesh]:
    """The object's mesh, or in Edit Mode, where that cannot be read, a passing copy of it."""
    if obj.mode != "EDIT":
        yield obj.data
        return
    obj.update_from_editmode()
    copy = obj.data.copy()
    try:
        yield copy
    finally:
        bpy.data.meshes.remove(copy)


def triangles(
    obj: bpy.types.Object, mesh: bpy.types.Mesh, material: bpy.types.Material, uv_map: str
) -> tuple[Array, Array]:
    """The triangles of `mesh`, which is that of `obj`, that show the material.

    Corners in the object's space [T, 3, 3] and UVs [T, 3, 2].
    """
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    loops = np.empty(count * 3, np.int32)
    vertices = np.empty(count * 3, np.int32)
    faces = np.empty(count, np.int32)
    mesh.loop_triangles.foreach_get("loops", loops)
    mesh.loop_triangles.foreach_get("vertices", vertices)
    mesh.loop_triangles.foreach_get("material_index", faces)
    uv = np.empty(len(mesh.loops) * 2, np.float32)
    mesh.uv_layers[uv_map].data.foreach_get("uv", uv)
    places = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", places)
    slots = [i for i, slot in enumerate(obj.material_slots) if slot.material == material]
    last = len(obj.material_slots) - 1
    shown = np.isin(np.clip(faces, 0, last), slots)
    corners = places.reshape(-1, 3)[vertices.reshape(-1, 3)[shown]]
    return corners, uv.reshape(-1, 2)[loops.reshape(-1, 3)[shown]]
