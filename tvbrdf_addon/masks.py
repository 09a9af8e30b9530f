"""An artist's mask of where aging starts: `material.tvbrdf.mask_source` and what it names."""

from __future__ import annotations

from typing import Any

import bpy

from ..model_runtime.contract import AUTO, MASK_MEANINGS, AgeRequest
from .known import known, scene_of
from .material.nodes.ownership import TAG
from .material.reading.chosen import object_with

__all__ = ("ATTRIBUTE", "IMAGE", "NO_MASK", "Masks", "asked", "draw", "is_still", "means")

NO_MASK, IMAGE, ATTRIBUTE = "none", "image", "attribute"
_SOURCES = (
    (NO_MASK, "None", "Nothing is painted"),
    (IMAGE, "Image", "An image, laid out as the material's textures are"),
    (
        ATTRIBUTE,
        "Color Attribute",
        "What is painted on the mesh, as in Vertex Paint mode",
    ),
)


def is_still(_self: Any, image: bpy.types.Image) -> bool:
    """Whether an image can say where aging starts."""
    return image.source in ("FILE", "GENERATED") and TAG not in image


def _take_active_attribute(self: Any, context: bpy.types.Context) -> None:
    obj = context.object
    if self.mask_source == ATTRIBUTE and not self.mask_attribute and obj and obj.type == "MESH":
        self.mask_attribute = obj.data.color_attributes.active_color_name


class Masks:
    """Of a material's settings, those of its mask."""

    mask_source: bpy.props.EnumProperty(
        name="Mask",
        description="What you painted to say where aging starts, or where it never does",
        items=_SOURCES,
        default=NO_MASK,
        update=_take_active_attribute,
    )
    mask_image: bpy.props.PointerProperty(
        name="Mask Image",
        description="Grayscale image; painted in Blender, it counts as it is now",
        type=bpy.types.Image,
        poll=is_still,
    )
    mask_attribute: bpy.props.StringProperty(
        name="Attribute",
        description="Color attribute that is painted on the mesh, of vertices or of face corners",
    )
    mask_means: bpy.props.EnumProperty(
        name="White",
        description="What happens where the mask is white",
        items=tuple((name, told.title, told.meaning) for name, told in MASK_MEANINGS.items()),
        default=AgeRequest.mask_means,
    )


def means(settings: Any) -> str | None:
    """What white means, of a material's settings; None where no mask counts."""
    return (
        settings.mask_means if settings.onset == AUTO and settings.mask_source != NO_MASK else None
    )


def asked(settings: Any) -> tuple[str, ...]:
    """What pictures depend on, of a material's settings."""
    if means(settings) is None:
        return ()
    image = settings.mask_image
    named = settings.mask_attribute if settings.mask_source == ATTRIBUTE else image and image.name
    return settings.mask_source, named or "", settings.mask_means


def draw(
    layout: bpy.types.UILayout, context: bpy.types.Context, material: bpy.types.Material
) -> None:
    settings = material.tvbrdf
    column = known(layout).column()
    column.prop(settings, "mask_source")
    if settings.mask_source == NO_MASK:
        return
    obj = object_with(material, scene_of(context))
    if settings.mask_source == IMAGE:
        column.template_ID(settings, "mask_image", new="image.new", open="image.open")
    elif obj is not None and obj.type == "MESH":
        column.prop_search(settings, "mask_attribute", obj.data, "color_attributes")
    else:
        column.prop(settings, "mask_attribute")
    column.prop(settings, "mask_means")
