"""Keys and drivers of a material and its node tree, the same way in Blender 4.2 to 5.x."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import bpy

from ...known import tree_of
from .ownership import TAG, once_unread, user_count

__all__ = (
    "Animated",
    "AnimationBefore",
    "FCurves",
    "channels",
    "copy_animation",
    "drive_by_age",
    "key",
    "key_property",
    "own_action",
    "property_path",
    "remove_keys",
)

Animated: TypeAlias = bpy.types.NodeTree | bpy.types.Material | bpy.types.Object
FCurves: TypeAlias = "bpy.types.ActionFCurves | Sequence[bpy.types.FCurve]"


@dataclass(frozen=True)
class AnimationBefore:
    """The animation data of a material, or its node tree, before aging touched it."""

    existed: bool
    action: str | None = None
    slot: str | None = None
    last_slot: str = ""

    @classmethod
    def of(cls, owner: Animated) -> AnimationBefore:
        data = owner.animation_data
        if data is None:
            return cls(existed=False)
        slot = getattr(data, "action_slot", None)
        return cls(
            existed=True,
            action=data.action.name if data.action else None,
            slot=slot.identifier if slot else None,
            last_slot=getattr(data, "last_slot_identifier", ""),
        )

    def claim(self, owner: Animated) -> None:
        """Marks an action that aging gave the owner, so that it is known to be ours later."""
        if self.action is None and owner.animation_data and owner.animation_data.action:
            owner.animation_data.action[TAG] = 1

    def restore(self, owner: Animated) -> None:
        """Puts back the action that was there; one of ours with nothing left in it goes."""
        data = owner.animation_data
        if data is None:
            return
        action = data.action
        if action is not None and TAG in action:
            now = _as_values(channels(owner))
            same = [
                each for each in _sources(action) if _as_values(_curves(each, self.slot)) == now
            ]
            if same or not len(channels(owner)):
                _assign(data, same[-1] if same else None, self.slot)
                _remove_unused(action)
            else:
                del action[TAG]  # the artist has changed it
        if hasattr(data, "last_slot_identifier") and data.action is None:
            data.last_slot_identifier = self.last_slot
        if not self.existed and not (data.action or data.drivers or data.nla_tracks):
            owner.animation_data_clear()


def _sources(action: bpy.types.Action) -> list[bpy.types.Action]:
    """What an action of ours was copied from, the nearest first."""
    held = action.get(TAG)
    return [held, *_sources(held)] if isinstance(held, bpy.types.Action) else []


def _remove_unused(action: bpy.types.Action) -> None:
    """Removes an action of ours that nothing uses, and those that it was copied from."""
    if TAG in action:
        once_unread(_remove_action, action)


def _remove_action(action: bpy.types.Action) -> None:
    if user_count(action) == 0:
        sources = _sources(action)
        bpy.data.actions.remove(action)
        for each in sources[:1]:
            _remove_unused(each)


def own_action(owner: Animated, *, mark: bool = False) -> None:
    """Gives its owner a copy of an action that it shares, so that no other one is touched.

    With `mark` the copy is known to be ours and holds what it was made of, which
    `AnimationBefore.restore` puts back.
    """
    data = owner.animation_data
    if data is None or data.action is None:
        return
    shared = data.action
    if user_count(shared) > 1 or shared.library:
        slot = getattr(data, "action_slot", None)
        identifier = slot.identifier if slot else None
        _assign(data, shared.copy(), identifier)
        if mark:
            data.action[TAG] = shared


def _assign(data: bpy.types.AnimData, action: bpy.types.Action | None, slot: str | None) -> None:
    data.action = action
    if action and slot and hasattr(data, "action_slot"):
        slots = {each.identifier: each for each in action.slots}
        data.action_slot = slots.get(slot, data.action_slot)


def channels(owner: Animated) -> FCurves:
    """The F-curves that animate a data-block: Blender's own collection, or nothing."""
    data = owner.animation_data
    if data is None or data.action is None:
        return ()
    slot = getattr(data, "action_slot", None)
    return _curves(data.action, slot.identifier if slot else None)


def _curves(action: bpy.types.Action, slot: str | None) -> FCurves:
    """The F-curves of a slot of an action; up to Blender 4.3, which has no slots, all."""
    if not hasattr(action, "slots"):
        return action.fcurves
    found = next((each for each in action.slots if each.identifier == slot), None)
    for layer in action.layers:
        for strip in layer.strips:
            bag = strip.channelbag(found) if found else None
            if bag is not None:
                return bag.fcurves
    return ()


def _as_values(curves: FCurves) -> list[tuple[object, ...]]:
    return [
        (curve.data_path, curve.array_index, point.interpolation, *point.co, *point.handle_right)
        for curve in curves
        for point in curve.keyframe_points
    ]


def key(
    socket: bpy.types.NodeSocket, values: Sequence[float | Sequence[float]], at: Sequence[float]
) -> None:
    """Keys `socket.default_value` to `values` at the frames `at`, straight from key to key."""
    _give_action(tree_of(socket))
    for value, frame in zip(values, at, strict=True):
        socket.default_value = value
        socket.keyframe_insert("default_value", frame=frame)
    _straighten(tree_of(socket), socket.path_from_id("default_value"))


def key_property(owner: Animated, name: str, values: Sequence[float], at: Sequence[float]) -> None:
    """`key` for a custom property of a data-block."""
    _give_action(owner)
    path = property_path(name)
    for value, frame in zip(values, at, strict=True):
        owner[name] = value
        owner.keyframe_insert(path, frame=frame)
    _straighten(owner, path)


def property_path(name: str) -> str:
    """The data path of a custom property."""
    return f'["{bpy.utils.escape_identifier(name)}"]'


def _give_action(owner: Animated) -> None:
    """An action of its own: without one Blender (4.4 on) would key in that of a related one."""
    data = owner.animation_data or owner.animation_data_create()
    if data.action is None:
        data.action = bpy.data.actions.new(f"{owner.name} Age")


def _straighten(owner: Animated, path: str) -> None:
    for curve in channels(owner):
        if curve.data_path == path:
            for point in curve.keyframe_points:
                point.interpolation = "LINEAR"


def copy_animation(source: bpy.types.NodeSocket, target: bpy.types.NodeSocket) -> None:
    """Moves a socket's value as that of another one of its tree is moved, by keys and drivers."""
    tree, path = tree_of(source), source.path_from_id("default_value")
    curves = channels(tree)
    for curve in [each for each in curves if each.data_path == path]:
        copy = curves.new(target.path_from_id("default_value"), index=curve.array_index)
        copy.extrapolation = curve.extrapolation
        for point in curve.keyframe_points:
            made = copy.keyframe_points.insert(*point.co, options={"FAST"})
            for name in ("interpolation", "easing", "handle_left_type", "handle_right_type"):
                setattr(made, name, getattr(point, name))
            made.handle_left, made.handle_right = point.handle_left, point.handle_right
        copy.update()
    data = tree.animation_data
    for driver in [each for each in data.drivers if each.data_path == path] if data else ():
        copy = data.drivers.from_existing(src_driver=driver)
        copy.data_path = target.path_from_id("default_value")


def remove_keys(owner: Animated, path: str) -> None:
    """Takes away the F-curves of a property."""
    curves = channels(owner)
    for curve in [each for each in curves if each.data_path == path]:
        curves.remove(curve)


def drive_by_age(
    driven: bpy.types.bpy_struct,
    path: str,
    *,
    material: bpy.types.Material,
    age: str,
    last: int = 1,
    points: Sequence[tuple[int, float]] = (),
    interpolation: Literal["CONSTANT", "LINEAR"] = "LINEAR",
) -> None:
    """Drives the property `path` of `driven` by the custom property `age` of the material: with
    its value, or along a curve through `points`.

    A point is a modeled frame, from 0 at Age 0 to `last` at Age 1, and the value from there on
    or there.  The expression is a simple one: Blender evaluates it, and the curve, without Python,
    so it also works in a file whose scripts may not run.
    """
    curve = driven.driver_add(path)
    if points:
        for modifier in list(curve.modifiers):
            curve.modifiers.remove(modifier)
    for frame, value in points:
        curve.keyframe_points.insert(frame, value).interpolation = interpolation
    driver = curve.driver
    variable = driver.variables.new()
    variable.name = "age"
    target = variable.targets[0]
    # A property of the material: one of the tree would depend on the tree that it drives.
    target.id_type = "MATERIAL"
    target.id = material
    target.data_path = property_path(age)
    driver.type = "SCRIPTED"
    driver.expression = f"clamp(age) * {last}"
    assert driver.is_simple_expression
