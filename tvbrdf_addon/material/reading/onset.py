"""Whether the user says when each texel starts to age, and where.  Cheap: panels call it."""

from __future__ import annotations

import bpy

from ....model_runtime.contract import AUTO

__all__ = (
    "bearers",
    "is_invertible",
    "is_painted",
    "is_shown",
    "showing",
    "why_no_mask",
    "why_no_onset",
)


def is_painted(material: bpy.types.Material) -> bool:
    """Whether a color attribute of the mesh says when each texel starts."""
    return material.tvbrdf.onset == "attribute"


def is_invertible(material: bpy.types.Material) -> bool:
    """Whether the start comes in shades, which may mean this or the opposite."""
    return material.tvbrdf.onset in ("attribute", "image")


def showing(
    material: bpy.types.Material, scene: bpy.types.Scene | None = None
) -> list[bpy.types.Object]:
    """The objects of the scene, or of the file, that show `material`."""
    objects = bpy.data.objects if scene is None else scene.objects
    return [obj for obj in objects if is_shown(material, obj)]


def is_shown(material: bpy.types.Material, obj: bpy.types.Object) -> bool:
    """Whether an object shows `material`: it is in a slot, or geometry nodes give it."""
    if any(slot.material == material for slot in obj.material_slots):
        return True
    if obj.type != "MESH" or all(modifier.type != "NODES" for modifier in obj.modifiers):
        return False
    seen = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return any(each is not None and each.original == material for each in seen.data.materials)


def bearers(
    material: bpy.types.Material, scene: bpy.types.Scene, name: str
) -> list[bpy.types.Object]:
    """Those of them that have UVs and a color attribute of that name."""
    return [obj for obj in showing(material, scene) if _bears(obj, name) and obj.data.uv_layers]


def why_no_onset(material: bpy.types.Material, scene: bpy.types.Scene) -> str | None:
    """One sentence why nothing can be read from what `material` says of its start, or None."""
    settings = material.tvbrdf
    if settings.onset == "image":
        return _why_no_image(settings.onset_image)
    if settings.onset != "attribute":
        return None
    name = settings.onset_attribute
    if not name:
        return "No color attribute is chosen: choose one, or let aging start in spots."
    objects = showing(material, scene)
    if not objects or bearers(material, scene, name):
        return None  # without objects there are no UVs either, and that is said first
    return _why_no_attribute(objects, name)


def why_no_mask(material: bpy.types.Material, scene: bpy.types.Scene) -> str | None:
    """One sentence why nothing can be read from the mask of `material`, or None."""
    settings = material.tvbrdf
    if settings.onset != AUTO:
        return None
    if settings.mask_source == "image":
        if settings.mask_image is None:
            return "No mask image is chosen: choose one, or set Mask to None."
        return None
    if settings.mask_source != "attribute":
        return None
    name, objects = settings.mask_attribute, showing(material, scene)
    if not name:
        return "No color attribute is chosen for the mask: choose one, or set Mask to None."
    if not objects or any(_bears(obj, name) for obj in objects):
        return None
    return _why_no_attribute(objects, name)


def _why_no_image(image: bpy.types.Image | None) -> str | None:
    if image is None:
        return "No start image is chosen: choose one, or let aging start in spots."
    if image.source not in ("FILE", "GENERATED", "TILED"):
        return f"The start image “{image.name}” is no still image: choose one that is."
    return None


def _why_no_attribute(objects: list[bpy.types.Object], name: str) -> str:
    bearing = next((obj for obj in objects if _bears(obj, name)), None)
    if bearing is not None:
        return f"The mesh of “{bearing.name}” has no UV map: unwrap it (UV > Smart UV Project)."
    meshes = [obj for obj in objects if obj.type == "MESH"]
    other = next((obj for obj in meshes if name in obj.data.attributes), None)
    if other is not None:
        return (
            f"“{name}” of “{other.name}” is no color attribute: convert it under Object Data > "
            "Attributes, to Color on Vertex or Face Corner."
        )
    who = f"“{objects[0].name}” has no" if len(objects) == 1 else "No object that shows this has a"
    there = sorted({each.name for obj in meshes for each in obj.data.color_attributes})
    hint = f"there is {', '.join(there[:5])}" if there else "paint one in Vertex Paint mode"
    return f"{who} color attribute “{name}”: {hint}."


def _bears(obj: bpy.types.Object, name: str) -> bool:
    return obj.type == "MESH" and name in obj.data.color_attributes
