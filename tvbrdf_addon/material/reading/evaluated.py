"""An object as a render shows it: its mesh after all modifiers, at a frame, hidden or not.

What is looked at is what is then baked, so nothing that Cycles would die of reaches it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ...known import known
from .passing import discard, passing, stage

__all__ = (
    "Evaluated",
    "alike",
    "distinct",
    "evaluated",
    "in_view",
    "mesh_of",
    "stand_in",
)

Array = NDArray[np.float32]

_FINEST = 11  # levels of subdivision that Blender knows

# Modifiers that move vertices and leave Generated coordinates where these were.
_DEFORMING = frozenset(
    (
        *("ARMATURE", "CAST", "CLOTH", "CORRECTIVE_SMOOTH", "CURVE", "DISPLACE", "HOOK"),
        *("LAPLACIANDEFORM", "LAPLACIANSMOOTH", "LATTICE", "MESH_CACHE", "MESH_DEFORM"),
        *("SHRINKWRAP", "SIMPLE_DEFORM", "SMOOTH", "SOFT_BODY", "SURFACE", "SURFACE_DEFORM"),
        *("VOLUME_DISPLACE", "WARP", "WAVE"),
    )
)


@dataclass(frozen=True)
class Evaluated:
    """A passing mesh, valid and without modifiers, whose materials are those that it really shows.

    `rest` [V, 3] are its vertices before they were deformed, which Generated coordinates follow;
    None where they are the same.  `basis` is the object's own transformation at the frame.
    """

    obj: bpy.types.Object
    mesh: bpy.types.Mesh
    basis: mathutils.Matrix
    rest: Array | None = None


@contextmanager
def evaluated(obj: bpy.types.Object, frame: int) -> Iterator[Evaluated]:
    """The object at `frame`; nothing in the file is changed, and the mesh is gone afterwards."""
    with passing() as made:
        seen = stand_in(obj, made)
        scene = stage("tvbrdf look", [seen], made)
        scene.frame_set(frame)
        mesh = mesh_of(seen, scene)
        made.append(mesh)
        mesh.validate(clean_customdata=False)  # takes out what is no number, too
        depsgraph = known(scene.view_layers[0].depsgraph)
        basis = seen.evaluated_get(depsgraph).matrix_basis.copy()
        yield Evaluated(obj, mesh, basis, _rest(seen, scene, mesh))


@contextmanager
def in_view(
    obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph
) -> Iterator[tuple[bpy.types.Mesh, list[bpy.types.Material | None]]]:
    """The mesh as the view shows it, and its materials: for panels, as nothing is made for it."""
    seen = obj.evaluated_get(depsgraph)
    try:
        slots = [slot.material and slot.material.original for slot in seen.material_slots]
        yield seen.to_mesh(), slots
    finally:
        seen.to_mesh_clear()


def distinct(objects: Iterable[bpy.types.Object]) -> list[bpy.types.Object]:
    """One object of those that are seen alike: linked duplicates are many and are one mesh."""
    return [first for first, *_ in alike(objects)]


def alike(objects: Iterable[bpy.types.Object]) -> list[list[bpy.types.Object]]:
    """The objects in groups that are seen alike."""
    groups: dict[tuple[object, ...], list[bpy.types.Object]] = {}
    for obj in objects:
        own = [obj] if len(obj.modifiers) else []
        slots = (slot.material for slot in obj.material_slots)
        groups.setdefault((obj.data, obj.mode, *slots, *own), []).append(obj)
    return list(groups.values())


def stand_in(
    obj: bpy.types.Object, made: list[bpy.types.ID], *, realize: bool = True
) -> bpy.types.Object:
    """The object again, visible, with the modifiers that a render applies; it and what it needs are
    `made` in passing.

    Instances that its nodes make are part of its mesh, unless these are not to be realized.
    """
    copy = obj.copy()
    made.append(copy)
    if obj.type == "MESH" and obj.mode == "EDIT":  # then it cannot be read
        obj.update_from_editmode()
        copy.data = known(obj.data).copy()
        made.append(copy.data)
    copy.hide_viewport = copy.hide_render = False
    simple = [scene.render for scene in obj.users_scene if scene.render.use_simplify]
    most = min((each.simplify_subdivision_render for each in simple), default=_FINEST)
    for modifier in copy.modifiers:
        modifier.show_viewport = modifier.show_render
        if modifier.type in ("SUBSURF", "MULTIRES"):
            modifier.levels = min(modifier.render_levels, most)
    if realize and any(modifier.type == "NODES" for modifier in copy.modifiers):
        made.append(_make_instances_real(copy))
    return copy


def _make_instances_real(obj: bpy.types.Object) -> bpy.types.NodeTree:
    """Adds nodes that do, which have to be removed with the object."""
    group = bpy.data.node_groups.new("tvbrdf look", "GeometryNodeTree")
    for side in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Mesh", in_out=side, socket_type="NodeSocketGeometry")
    begin, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    realize = group.nodes.new("GeometryNodeRealizeInstances")
    group.links.new(begin.outputs[0], realize.inputs[0])
    group.links.new(realize.outputs[0], end.inputs[0])
    obj.modifiers.new("tvbrdf look", "NODES").node_group = group
    return group


def mesh_of(obj: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.Mesh:
    """The mesh that an object of a scene is at its frame, with what its slots show; a new one."""
    depsgraph = known(scene.view_layers[0].depsgraph)
    depsgraph.update()
    seen = obj.evaluated_get(depsgraph)
    try:
        mesh = bpy.data.meshes.new_from_object(
            seen, preserve_all_data_layers=True, depsgraph=depsgraph
        )
    except RuntimeError:  # nothing that has faces: an empty, a volume
        mesh = bpy.data.meshes.new("tvbrdf look")
    # Slots may be the object's own, and the mesh's list does not say so.
    for i, slot in enumerate(seen.material_slots):
        material = slot.material.original if slot.material else None
        if i < len(mesh.materials):
            mesh.materials[i] = material
        else:
            mesh.materials.append(material)
    if obj.type == "MESH":
        # Generated coordinates are relative to the mesh without modifiers.
        place, size = obj.data.texspace_location.copy(), obj.data.texspace_size.copy()
        mesh.use_auto_texspace = False
        mesh.texspace_location, mesh.texspace_size = place, size
    return mesh


def _rest(obj: bpy.types.Object, scene: bpy.types.Scene, mesh: bpy.types.Mesh) -> Array | None:
    deforming = [each for each in obj.modifiers if each.type in _DEFORMING and each.show_viewport]
    keyed = obj.type == "MESH" and obj.data.shape_keys is not None
    if not deforming and not keyed:
        return None
    for modifier in deforming:
        modifier.show_viewport = False
    if keyed:
        obj.active_shape_key_index, obj.show_only_shape_key = 0, True
    undeformed = mesh_of(obj, scene)
    try:
        if len(undeformed.vertices) != len(mesh.vertices):
            return None
        places = np.empty(len(undeformed.vertices) * 3, np.float32)
        undeformed.vertices.foreach_get("co", places)
        return places.reshape(-1, 3)
    finally:
        discard(undeformed)
