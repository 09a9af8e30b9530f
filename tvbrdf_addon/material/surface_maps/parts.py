"""A mesh as a render sees it: triangles, which of them show a material, and those in the world."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ..reading.unwrap import active_uv_map
from .charts import Faces
from .shells import turned_in

__all__ = ("Mesh", "Part", "Shown", "read_mesh")

Array = NDArray[np.float32]
Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Part:
    """Triangles that show the material, of one of the objects and instances that are seen alike.

    `faces` lie in the world and go counterclockwise as seen from outside, where `normals`
    [T, 3, 3] point; `uv` is [T, 3, 2], None without a UV map; `painted` [T, 3, ...] is what a mask
    has there, None where it has nothing.  `obj` stands at `matrix`, and `others` count those that
    are seen alike beside it.
    """

    obj: bpy.types.Object
    matrix: mathutils.Matrix
    faces: Faces
    normals: Array
    uv: Array | None
    painted: Array | None
    others: int


@dataclass(frozen=True)
class Shown:
    """A mesh as Blender has it, some faces of which show the material; the rest as in `Part`."""

    obj: bpy.types.Object
    mesh: Mesh
    matrix: mathutils.Matrix
    others: int

    def part(self) -> Part:
        """What is shown as it lies in the world."""
        mesh, shows = self.mesh, self.mesh.shows
        triangles, polygons, normals = (
            mesh.triangles[shows],
            mesh.polygons[shows],
            mesh.normals[shows],
        )
        at_corners = [each if each is None else each[shows] for each in (mesh.uv, mesh.painted)]
        world = np.array(self.matrix, np.float64)
        places = (mesh.vertices @ world[:3, :3].T + world[:3, 3]).astype(np.float32)
        mirrors = np.linalg.det(world[:3, :3]) < 0
        # By the inverse transpose, times the determinant's size: no scale is too small for that.
        x, y, z = world[:3, :3].T
        turn = np.stack((np.cross(y, z), np.cross(z, x), np.cross(x, y)))
        normals = normals @ (-turn if mirrors else turn)
        if mirrors:  # triangles turn over
            triangles, normals = triangles[:, ::-1], normals[:, ::-1]
            at_corners = [each if each is None else each[:, ::-1] for each in at_corners]
        turned = turned_in(places[triangles], triangles)
        triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
        normals = np.where(turned[:, None, None], -normals[:, ::-1], normals)
        uv, painted = (
            each if each is None else np.where(turned[:, None, None], each[:, ::-1], each)
            for each in at_corners
        )
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)
        faces = Faces(places[triangles], triangles, polygons)
        return Part(
            self.obj, self.matrix, faces, normals.astype(np.float32), uv, painted, self.others
        )

    def bytes(self) -> Iterator[bytes]:
        """All that its part is made from, but for what is painted."""
        mesh = self.obj.data
        assert isinstance(mesh, bpy.types.Mesh)
        about = (self.obj.name, self.others, mesh.session_uid, len(mesh.loops), mesh.is_editmode)
        yield repr(about).encode()
        yield np.array(self.matrix, np.float64).tobytes()
        for name, values in vars(self.mesh).items():
            if name not in ("painted", "materials"):
                yield b"" if values is None else values.tobytes()


@dataclass(frozen=True)
class Mesh:
    """Vertices [V, 3] and triangles [T, 3] of a mesh, what these show, and what lies at corners;
    `slots` [T] number the mesh's `materials`.
    """

    vertices: Array
    triangles: Numbers
    polygons: Numbers
    slots: Numbers
    materials: tuple[bpy.types.Material | None, ...]
    shows: NDArray[np.bool_]
    normals: Array
    uv: Array | None
    painted: Array | None


_NO_MESH = Mesh(
    vertices=np.zeros((0, 3), np.float32),
    triangles=np.zeros((0, 3), np.int64),
    polygons=np.zeros(0, np.int64),
    slots=np.zeros(0, np.int64),
    materials=(),
    shows=np.zeros(0, bool),
    normals=np.zeros((0, 3, 3), np.float32),
    uv=None,
    painted=None,
)


def read_mesh(
    copy: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    material: bpy.types.Material,
    uv_map: str,
    *,
    but: str | None = None,
    painted: Callable[[bpy.types.Mesh], Array | None] = lambda mesh: None,
) -> Mesh:
    """The evaluated mesh, without the triangles of it that are nowhere; its UV map is any `but`
    that one.
    """
    seen = copy.evaluated_get(depsgraph)
    try:
        # Not a mesh of the file's: for each of these all objects would be looked at anew.
        mesh = seen.to_mesh(preserve_all_data_layers=True, depsgraph=depsgraph)
    except RuntimeError:  # nothing that has faces: an empty, a volume
        return _NO_MESH
    try:
        mesh.calc_loop_triangles()
        vertices = _read(mesh.vertices, "co", 3)
        triangles, loops, polygons, slots = (
            _read(mesh.loop_triangles, name, width, np.int32).astype(np.int64)
            for name, width in (
                ("vertices", 3),
                ("loops", 3),
                ("polygon_index", 1),
                ("material_index", 1),
            )
        )
        materials = _materials(seen, mesh)
        slots = slots[:, 0].clip(0, max(len(materials) - 1, 0))
        shows = np.array([*(each == material for each in materials), False])[slots]
        normals = _read(mesh.corner_normals, "vector", 3)
        name = uv_map if uv_map in mesh.uv_layers else active_uv_map(mesh)
        uv = None if name in (None, but) else _read(mesh.uv_layers[name].data, "uv", 2)
        shades = painted(mesh)
    finally:
        seen.to_mesh_clear()
    places = np.isfinite(vertices).all(1)
    there = places[triangles].all(1)
    vertices[~places] = 0
    loops = loops[there]
    return Mesh(
        vertices,
        triangles[there],
        polygons[there, 0],
        slots[there],
        materials,
        shows[there],
        normals[loops],
        None if uv is None else np.nan_to_num(uv[loops]),
        None if shades is None else shades[loops],
    )


def _materials(
    seen: bpy.types.Object, mesh: bpy.types.Mesh
) -> tuple[bpy.types.Material | None, ...]:
    """An evaluated object's materials: slots may be the object's own, and the mesh's list, which
    may be longer, does not say so.
    """
    own = [slot.material for slot in seen.material_slots]
    shown = [*own, *[*mesh.materials][len(own) :]]
    return tuple(each if each is None else each.original for each in shown)


def _read(
    collection: bpy.types.bpy_prop_collection, name: str, width: int, kind: type = np.float32
) -> np.ndarray:
    values = np.empty(len(collection) * width, kind)
    collection.foreach_get(name, values)
    return values.reshape(-1, width)
