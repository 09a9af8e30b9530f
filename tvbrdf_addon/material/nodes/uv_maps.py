"""UV maps that aging adds to meshes, and takes away again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import bpy

from ...errors import MaterialError
from .ownership import TAG

__all__ = ("give_uv_map", "owned_uv_map", "take_uv_map")


def give_uv_map(name: str, places: Mapping[int, Any]) -> None:
    """Adds a UV map of that name, which none of them has, to meshes: their places [L, 2], an array,
    by session uid.

    Raises `MaterialError`, with all meshes as they are, where one is not what it was.
    """
    meshes = {mesh.session_uid: mesh for mesh in bpy.data.meshes if mesh.session_uid in places}
    for uid, at in places.items():
        mesh = meshes.get(uid)
        if mesh is None or len(mesh.loops) != len(at) or mesh.is_editmode:
            which = "A mesh was deleted" if mesh is None else f"The mesh “{mesh.name}” was changed"
            raise MaterialError(
                f"{which} while its material was aging.", "Leave Edit Mode and age it again."
            )
    for uid, mesh in meshes.items():
        layer = mesh.uv_layers.new(name=name, do_init=False)
        layer.data.foreach_set("uv", places[uid].ravel())
        mesh[_mark(name)] = 1


def take_uv_map(name: str) -> None:
    """Removes that UV map of ours from all meshes, unless another aged material uses it."""
    if any(owned_uv_map(material) == name for material in bpy.data.materials):
        return
    for mesh in bpy.data.meshes:
        if mesh.library is None and mesh.get(_mark(name)):
            del mesh[_mark(name)]
            if name in mesh.uv_layers:
                mesh.uv_layers.remove(mesh.uv_layers[name])


def owned_uv_map(material: bpy.types.Material) -> str | None:
    """The UV map that was added for an aged material, as its record has it."""
    try:
        record = json.loads(material.tvbrdf.original or "{}")
    except ValueError:
        return None
    name = record.get("uv_map") if isinstance(record, dict) else None
    return name if isinstance(name, str) else None


def _mark(name: str) -> str:
    return f"{TAG} {name}"
