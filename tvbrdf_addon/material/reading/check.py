"""Whether a material can be aged, and if not, why, in one sentence.  Cheap: panels call it."""

from __future__ import annotations

import bpy

from ....model_runtime.contract import AUTO, EVERYWHERE, LIVE
from ...errors import MaterialError
from ..nodes.record import is_aged, require_local
from ..nodes.surface import find_principled
from ..nodes.trace import SOCKETS, upstream
from .onset import is_painted, is_shown
from .space import choose_space

__all__ = ("why_no_surface", "why_no_uv", "why_not", "why_nothing_to_learn")


def why_not(
    material: bpy.types.Material | None,
    obj: bpy.types.Object | None,
    *,
    owner: bpy.types.Material | None = None,
) -> str | None:
    """One sentence why `material` on `obj` cannot be aged, or None if it can.

    Where `material` is a temporary copy, `owner` is the material that it stands for.  Looks at
    nothing but nodes and UV layers; that an image on disk is broken or that UVs leave the
    unit square is found by `read`.
    """
    if material is None:
        return "There is no material to age: give the object one."
    owner = owner or material
    name = f"“{owner.name}”"
    try:
        require_local(owner)
    except MaterialError as error:
        return str(error)
    if material.is_grease_pencil:
        return f"{name} is a Grease Pencil material, which has no surface to age."
    if material.node_tree is None or not (bpy.app.version >= (5, 0) or material.use_nodes):
        return f"{name} does not use nodes: turn on Use Nodes and connect a Principled BSDF."
    if is_aged(material):
        return None
    return why_no_surface(material, owner) or _why_not_sockets(material, obj, owner)


def why_nothing_to_learn(material: bpy.types.Material, obj: bpy.types.Object | None) -> str | None:
    """One sentence why it cannot be learned from `material` on `obj` how it weathered, or None."""
    if material.node_tree is None or is_aged(material) or why_no_surface(material):
        return why_not(material, obj)
    place = find_principled(material)
    if choose_space(place.principled, place.groups).kind == "uniform":
        return (
            f"“{material.name}” is the same everywhere: choose a material that is clean in places "
            "and weathered in others."
        )
    return why_not(material, obj)


def why_no_surface(
    material: bpy.types.Material, owner: bpy.types.Material | None = None
) -> str | None:
    """Why the surface of the material is not one that can be aged, or None if it is."""
    try:
        find_principled(material, owner=owner)
    except MaterialError as error:
        return str(error)
    return None


def _why_not_sockets(
    material: bpy.types.Material, obj: bpy.types.Object | None, owner: bpy.types.Material
) -> str | None:
    name = f"“{owner.name}”"
    place = find_principled(material)
    sockets = [place.input(each) for each in SOCKETS.values()]
    for socket in sockets:
        for node, _ in upstream(socket, place.groups):
            if node.type == "TEX_IMAGE" and node.image is None:
                return f"The Image Texture “{node.name}” of {name} has no image: choose one."
    space = choose_space(place.principled, place.groups, painted=is_painted(owner))
    if space.reads_uv:
        return why_no_uv(owner, obj)
    # A plain material needs UVs only for the pattern in which it starts.
    settings = owner.tvbrdf
    if space.kind != "uniform" or settings.onset == EVERYWHERE:
        return None
    if (
        settings.onset == AUTO
        and settings.binding == LIVE
        and obj is not None
        and obj.type == "MESH"
    ):
        return None  # a UV map is made for that
    reason = why_no_uv(owner, obj)
    return reason and f"{reason.removesuffix('.')}, or set Start to Everywhere at Once."


def why_no_uv(material: bpy.types.Material, obj: bpy.types.Object | None) -> str | None:
    """Why `obj` offers no UV map for textures of the material, or None if it does."""
    name = f"“{material.name}”"
    if obj is None:
        return _why_no_object(material)
    if not is_shown(material, obj):
        return f"“{obj.name}” does not use {name}: select an object that does."
    if obj.type != "MESH":
        return f"“{obj.name}” is no mesh, so it has no UVs: use Object > Convert > Mesh."
    if not obj.data.uv_layers and not any(each.type == "NODES" for each in obj.modifiers):
        return f"The mesh of “{obj.name}” has no UV map: unwrap it (UV > Smart UV Project)."
    return None


def _why_no_object(material: bpy.types.Material) -> str:
    name = f"“{material.name}”"
    for obj in bpy.data.objects:
        elsewhere = obj.users_scene and bpy.context.scene not in obj.users_scene
        if elsewhere and is_shown(material, obj):
            scene = obj.users_scene[0].name
            return f"{name} is shown by “{obj.name}” of the scene “{scene}”: switch to that scene."
    wanted = "select an object that uses it in one of its material slots."
    return f"{name} has to become a texture: {wanted}"
