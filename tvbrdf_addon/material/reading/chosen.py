"""Which object a material is read from, of all that show it.  Cheap: panels call it."""

from __future__ import annotations

from array import array

import bpy

from ...errors import SettingsError
from .onset import is_shown, showing

__all__ = ("object_named", "object_with")


def object_with(material: bpy.types.Material, scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The object of the scene whose faces show `material`: one with UVs, the active one, a visible
    one, if it can be.

    Where none of the scene's own does, one that is instanced in it.
    """
    users = showing(material, scene) or _instanced(material)
    if len(users) < 2:
        return users[0] if users else None
    active = bpy.context.view_layer.objects.active if bpy.context.view_layer else None
    return max(
        users,
        key=lambda obj: (
            _has_faces(obj, material),
            obj.type == "MESH" and bool(obj.data.uv_layers),
            obj == active,
            obj.visible_get(),
        ),
    )


def object_named(
    name: str, material: bpy.types.Material, scene: bpy.types.Scene
) -> bpy.types.Object:
    """The object called `name`, which has to show `material`.  Raises `SettingsError`."""
    found = scene.objects.get(name) or bpy.data.objects.get(name)
    if found is None:
        raise SettingsError(f"There is no object called {name}.", _shown_by(material, scene))
    if found.users_scene and scene not in found.users_scene and found not in _instanced(material):
        raise SettingsError(
            f"The object {name} is in the scene {found.users_scene[0].name}, not in {scene.name}.",
            "Open that scene first.",
        )
    if not is_shown(material, found):
        raise SettingsError(
            f"The object {name} does not show {material.name}.", _shown_by(material, scene)
        )
    return found


def _shown_by(material: bpy.types.Material, scene: bpy.types.Scene) -> str:
    names = sorted(obj.name for obj in showing(material, scene))[:10]
    return f"{material.name} is shown by {', '.join(names) or 'no object of the scene'}."


def _instanced(material: bpy.types.Material) -> list[bpy.types.Object]:
    """The objects that show `material` and are in no scene, or that the scene has instances of."""
    users = showing(material)
    if not users:
        return []
    instances = bpy.context.evaluated_depsgraph_get().object_instances
    instanced = {each.object.original for each in instances if each.is_instance}
    return [obj for obj in users if obj in instanced or not obj.users_scene]


def _has_faces(obj: bpy.types.Object, material: bpy.types.Material) -> bool:
    """Whether any face, after modifiers, shows `material`, as far as the view shows the object."""
    if obj.type != "MESH":
        return True
    depsgraph = bpy.context.evaluated_depsgraph_get()
    seen = obj if obj.mode == "EDIT" else obj.evaluated_get(depsgraph)
    materials = [slot.material and slot.material.original for slot in seen.material_slots]
    shown = {i for i, each in enumerate(materials) if each == material}
    faces = array("i", bytes(4 * len(seen.data.polygons)))
    seen.data.polygons.foreach_get("material_index", faces)
    return any(min(index, len(materials) - 1) in shown for index in set(faces))
