"""All that shows a material in a scene, and all that stands around it, as a render sees it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ...known import known
from ..nodes.animation import channels
from ..nodes.uv_maps import owned_uv_map
from ..reading.evaluated import alike, stand_in
from ..reading.onset import is_shown
from ..reading.passing import passing, stage
from .painted import Mask
from .parts import Mesh, Part, Shown, read_mesh

__all__ = ("Around", "Seen", "UVMap", "collect")

Array = NDArray[np.float32]
Numbers = NDArray[np.int64]
Matrices = list[mathutils.Matrix]

# What stands around is looked at as far as it stays below these: objects, and triangles in all.
_MOST_AROUND, _MOST_TRIANGLES = 500, 1_000_000
_MOST_INSTANCES = 100_000
_HAVE_FACES = ("MESH", "CURVE", "SURFACE", "FONT", "META")


@dataclass(frozen=True)
class UVMap:
    """A UV map that meshes are to have: its name, and by mesh (session uid) its places [L, 2]."""

    name: str
    places: Mapping[int, Array]


@dataclass(frozen=True)
class Around:
    """What may shelter the surface, or light it: triangles [T, 3] of vertices [V, 3], at matrices;
    their `slots` [T] number `materials`, and `uv` is [T, 3, 2], None without a UV map.
    """

    vertices: Array
    triangles: Numbers
    matrices: tuple[mathutils.Matrix, ...]
    slots: Numbers
    materials: tuple[bpy.types.Material | None, ...]
    uv: Array | None

    @classmethod
    def of(cls, mesh: Mesh, matrices: Matrices, but: NDArray[np.bool_] | None = None) -> Around:
        """A mesh, `but` some of its triangles, at matrices."""
        kept = np.ones(len(mesh.triangles), bool) if but is None else ~but
        uv = None if mesh.uv is None else mesh.uv[kept]
        slots = mesh.slots[kept]
        return cls(mesh.vertices, mesh.triangles[kept], tuple(matrices), slots, mesh.materials, uv)


@dataclass(frozen=True)
class Seen:
    """What shows the material, all else, and the objects that show it and are no meshes; and the
    mask that was looked for.
    """

    shown: tuple[Shown, ...]
    around: tuple[Around, ...]
    no_meshes: tuple[bpy.types.Object, ...]
    mask: Mask | None

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """What is shown as it lies in the world, in the same order."""
        return tuple(each.part() for each in self.shown)


def collect(
    material: bpy.types.Material,
    scene: bpy.types.Scene,
    frame: int,
    *,
    uv_map: str = "",
    given: UVMap | None = None,
    mask: Mask | None = None,
) -> Seen:
    """What a render of `scene` shows at `frame`; hidden objects where no other shows the material.

    UVs are those of `uv_map` where a mesh has it, else of the map that it renders with; `given` is
    one that the meshes do not have yet.  Nothing in the file is changed.
    """
    places, scattering = _rendered(scene), _scattering(material)
    users = [obj for obj in places if obj in scattering or is_shown(material, obj)]
    if not users:
        users = [obj for obj in scene.objects if is_shown(material, obj)]
        places.update({obj: (True, []) for obj in users})
    meshes = [obj for obj in users if obj.type == "MESH"]
    others = [obj for obj in places if obj not in meshes and _shelters(obj)]
    others = _nearest(others, users)
    with passing() as made:
        # One scene for all: to make one and to look at it takes its time.
        copies = {obj: stand_in(obj, made, realize=obj in meshes) for obj in (*meshes, *others)}
        if given is not None:
            for obj in meshes:
                _give_uv_map(copies[obj], obj, given, made)
        look = stage("tvbrdf look", copies.values(), made)
        look.frame_set(frame)
        depsgraph = known(look.view_layers[0].depsgraph)
        depsgraph.update()

        def matrices(objects: Sequence[bpy.types.Object]) -> Matrices:
            own = [
                copies[obj].evaluated_get(depsgraph).matrix_world.copy()
                for obj in objects
                if places[obj][0]
            ]
            return own + [matrix for obj in objects for matrix in places[obj][1]]

        shown, around, triangles = [], [], 0
        ours = owned_uv_map(material)
        added = ours if given is None else given.name

        def painted(mesh: bpy.types.Mesh) -> Array | None:
            return None if mask is None else mask.at_corners(mesh, but=added)

        for group in alike(meshes):
            name = given.name if given is not None else uv_map
            but = ours if given is None else None
            mesh = read_mesh(copies[group[0]], depsgraph, material, name, but=but, painted=painted)
            first, *more = matrices(group)
            if mesh.shows.any():
                shown.append(Shown(group[0], mesh, first, len(more)))
                around.append(Around.of(mesh, [first], but=mesh.shows))
            around.append(Around.of(mesh, more))
        for group in alike(others):
            if triangles > _MOST_TRIANGLES:
                break
            mesh = read_mesh(copies[group[0]], depsgraph, material, "")
            around.append(Around.of(mesh, matrices(group)))
            triangles += len(mesh.triangles)
    there = tuple(each for each in around if len(each.triangles) and each.matrices)
    return Seen(tuple(shown), there, tuple(obj for obj in users if obj not in meshes), mask)


def _rendered(scene: bpy.types.Scene) -> dict[bpy.types.Object, tuple[bool, Matrices]]:
    """The objects that a render of the scene shows: whether by themselves, and where instances of
    them stand now, without those that geometry nodes make.
    """
    found: dict[bpy.types.Object, tuple[bool, Matrices]] = {}
    layers = [scene.view_layers[0].layer_collection]
    while layers:
        layer = layers.pop()
        if not layer.exclude and not layer.collection.hide_render:
            layers.extend(layer.children)
            for obj in layer.collection.objects:
                if obj.type in _HAVE_FACES and not _is_hidden(obj):
                    by_itself = obj.parent is None or obj.parent.instance_type == "NONE"
                    found[obj] = (by_itself, [])
    for each in _instances():
        if not _has_nodes(known(each.parent)) and each.object.type in _HAVE_FACES:
            obj = known(each.object.original)
            _, matrices = found.setdefault(obj, (False, []))
            matrices.append(each.matrix_world.copy())
    return {obj: (own, matrices) for obj, (own, matrices) in found.items() if own or matrices}


def _scattering(material: bpy.types.Material) -> set[bpy.types.Object]:
    """The objects whose geometry nodes make instances that show the material."""
    return {
        known(known(each.parent).original)
        for each in _instances()
        if _has_nodes(known(each.parent)) and _is_in(material, each.object.data)
    }


def _instances() -> Iterator[bpy.types.DepsgraphObjectInstance]:
    instances = bpy.context.evaluated_depsgraph_get().object_instances
    for each in islice(instances, _MOST_INSTANCES):
        if each.is_instance and each.parent is not None:
            yield each


def _has_nodes(obj: bpy.types.Object) -> bool:
    return any(modifier.type == "NODES" for modifier in obj.modifiers)


def _is_in(material: bpy.types.Material, data: bpy.types.ID | None) -> bool:
    there = (each for each in getattr(data, "materials", ()) if each is not None)
    return any(each.original == material for each in there)


def _is_hidden(obj: bpy.types.Object) -> bool:
    """Whether renders never show an object."""
    data = obj.animation_data
    curves = [] if data is None else [*channels(obj), *data.drivers]
    return obj.hide_render and all(curve.data_path != "hide_render" for curve in curves)


def _shelters(obj: bpy.types.Object) -> bool:
    """Whether an object has a surface that keeps light and rain off, as far as is known."""
    materials = [slot.material for slot in obj.material_slots if slot.material is not None]
    outputs = [
        known(each.node_tree).get_output_node("CYCLES") for each in materials if each.node_tree
    ]
    only_volume = outputs and not any(
        out is None or out.inputs["Surface"].is_linked for out in outputs
    )
    return obj.display_type not in ("WIRE", "BOUNDS") and not only_volume


def _nearest(
    objects: list[bpy.types.Object], users: list[bpy.types.Object]
) -> list[bpy.types.Object]:
    """Those of the objects that stand nearest to the users."""
    if not objects or not users:
        return []
    at, near = (
        np.array([each.matrix_world for each in some])[:, :3, 3] for some in (objects, users)
    )
    center = near.mean(0)
    order = np.argsort(np.linalg.norm(at - center, axis=1), kind="stable")
    return [objects[i] for i in order[:_MOST_AROUND].tolist()]


def _give_uv_map(
    copy: bpy.types.Object, obj: bpy.types.Object, given: UVMap, made: list[bpy.types.ID]
) -> None:
    """Gives a stand-in's mesh, which becomes its own, the map that `obj` is to have."""
    places = given.places.get(known(obj.data).session_uid)
    assert isinstance(copy.data, bpy.types.Mesh)
    copy.data = mesh = copy.data.copy()
    made.append(mesh)
    if places is not None and len(places) == len(mesh.loops):
        # One of an earlier aging may be there.
        layer = mesh.uv_layers.get(given.name) or mesh.uv_layers.new(name=given.name)
        layer.data.foreach_set("uv", places.ravel())
