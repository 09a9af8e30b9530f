"""The light that a material ages by: `material.tvbrdf.light`, and where north and the sun stand."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import bpy

from ..model_runtime.contract import AUTO

if TYPE_CHECKING:
    from ..model_runtime.model_files.weights import ModelCard
    from .material.surface_maps.light import Light

__all__ = ("LIGHTS", "Lights", "asked", "counts", "draw", "told")

BY_MODEL, NO_LIGHT, SUN, SCENE = "auto", "none", "sun", "scene"
LIGHTS = (
    (BY_MODEL, "As the Model Does", "What fades does by the sun's light, and all else spreads"),
    (NO_LIGHT, "None", "It spreads over the surface, whatever light falls on it"),
    (SUN, "Sun of a Year", "The more sun and sky a place sees in a year, the faster it ages"),
    (SCENE, "Lights of the Scene", "The more light of the scene falls on a place, the faster"),
)
_LIT = ("fading",)  # processes that light alone drives


class Lights:
    """Of a material's settings, those of the light."""

    light: bpy.props.EnumProperty(
        name="Light",
        description="What light it ages by: what is in the shade all day stays as it is",
        items=LIGHTS,
        default=BY_MODEL,
    )
    latitude: bpy.props.FloatProperty(
        name="Latitude",
        description="How far north it stands; negative in the south",
        default=math.radians(45),
        min=math.radians(-90),
        max=math.radians(90),
        subtype="ANGLE",
    )
    north: bpy.props.FloatProperty(
        name="North",
        description="Where north lies: 0 is along Y, 90° against X",
        default=0.0,
        subtype="ANGLE",
    )


def _meant(settings: Any, card: ModelCard | None) -> str:
    """What light it ages by, of a material's settings and the card of its model."""
    if settings.onset != AUTO:
        return NO_LIGHT
    if settings.light != BY_MODEL:
        return settings.light
    return SUN if card is not None and card.process in _LIT else NO_LIGHT


def counts(settings: Any, card: ModelCard | None) -> bool:
    """Whether it ages by light, and does not spread."""
    return _meant(settings, card) != NO_LIGHT


def asked(settings: Any, card: ModelCard | None, scene: bpy.types.Scene) -> Light | None:
    """The light that it ages by, if it does, of a material's settings."""
    from .material.surface_maps.light import Light

    meant = _meant(settings, card)
    if meant == NO_LIGHT:
        return None
    return Light(scene) if meant == SCENE else Light(None, settings.latitude, settings.north)


def told(settings: Any, card: ModelCard | None) -> tuple[Any, ...]:
    """What pictures depend on, of a material's settings."""
    meant = _meant(settings, card)
    return (meant, settings.latitude, settings.north) if meant == SUN else (meant,)


def draw(layout: bpy.types.UILayout, settings: Any, card: ModelCard | None) -> None:
    column = layout.column()
    column.prop(settings, "light")
    if _meant(settings, card) == SUN:
        column.prop(settings, "latitude")
        column.prop(settings, "north")
