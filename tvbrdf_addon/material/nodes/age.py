"""How old a material is: its custom property “Age”, 0 to 1, that everything else follows."""

from __future__ import annotations

import math
from collections.abc import Iterator

import bpy

from .animation import (
    AnimationBefore,
    channels,
    key_property,
    own_action,
    property_path,
    remove_keys,
)

__all__ = (
    "NAME",
    "age_at",
    "age_path",
    "as_age",
    "frame_range",
    "give_age",
    "hold_age",
    "take_age",
)

NAME = "Age"


def frame_range(material: bpy.types.Material, scene: bpy.types.Scene) -> tuple[int, int]:
    """First and last frame of aging."""
    settings = material.tvbrdf
    if settings.use_scene_range:
        return scene.frame_start, scene.frame_end
    return settings.frame_start, settings.frame_end


def give_age(material: bpy.types.Material, span: tuple[int, int]) -> tuple[AnimationBefore, str]:
    """Gives the material an age, keyed from 0 to 1 over the frames of `span`.

    Returns its animation data before, and the name of the property: “Age”, with a number where the
    material has another property of that name.
    """
    before = AnimationBefore.of(material)
    own_action(material, mark=True)
    name = next(each for each in _names() if each not in material)
    material[name] = 0.0
    material.id_properties_ui(name).update(
        min=0.0, max=1.0, default=0.0, description="How old the material is: 0 as made, 1 aged"
    )
    material.property_overridable_library_set(property_path(name), True)
    key_property(material, name, (0.0, 1.0), span)
    # Of a material that was animated before, Blender would not see the new property.
    material.update_tag()
    return before, name


def take_age(material: bpy.types.Material, name: str, before: AnimationBefore) -> None:
    """Takes the age away again, and its keys, and what drivers an artist gave it."""
    own_action(material)
    remove_keys(material, property_path(name))
    for driver in _drivers(material, property_path(name)):
        material.animation_data.drivers.remove(driver)
    material.pop(name, None)
    before.restore(material)


def age_at(material: bpy.types.Material, name: str, frame: float) -> float:
    """The age on a frame: that of its keys, or what it is now where it has none, 0 if it was
    deleted.
    """
    path, now = property_path(name), material.get(name)
    # What is no number cannot be keyed, and drivers of the artist are stronger than keys.
    keyed = isinstance(now, int | float) and not _drivers(material, path)
    curves = (each for each in channels(material) if each.data_path == path)
    curve = next(curves, None) if keyed else None
    return as_age(curve.evaluate(frame) if curve is not None else now)


def as_age(value: object) -> float:
    """An age as a render takes it: from 0 to 1, and 0 where it is no number."""
    if not isinstance(value, int | float) or math.isnan(value):
        return 0.0
    return min(max(float(value), 0.0), 1.0)


def hold_age(material: bpy.types.Material, name: str, frame: float) -> None:
    """Leaves the age as it is on a frame, without keys; one that was deleted stays so."""
    if name not in material:
        return
    own_action(material, mark=True)
    material[name] = age_at(material, name, frame)
    remove_keys(material, property_path(name))


def age_path(material: bpy.types.Material) -> str | None:
    """The data path of the property that ages the material; None where none does.  Cheap."""
    data = material.node_tree.animation_data if material.node_tree else None
    for curve in data.drivers if data else ():
        variable = curve.driver.variables.get("age")
        target = variable.targets[0] if variable is not None else None
        if target is not None and target.id == material and target.data_path.startswith("["):
            return target.data_path
    return None


def _drivers(material: bpy.types.Material, path: str) -> list[bpy.types.FCurve]:
    data = material.animation_data
    return [each for each in data.drivers if each.data_path == path] if data else []


def _names() -> Iterator[str]:
    yield NAME
    number = 2
    while True:
        yield f"{NAME} {number}"
        number += 1
