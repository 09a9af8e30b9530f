"""Keys and drivers of a node tree, the same way in Blender 4.2 to 5.x."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import bpy

from .ownership import TAG, user_count

__all__ = (
    "AnimationBefore",
    "channels",
    "drive_by_age",
    "key",
    "own_action",
    "remove_keys",
)


@dataclass(frozen=True)
class AnimationBefore:
    """The animation data of a node tree before ageing touched it."""

    existed: bool
    action: str | None = None
    slot: str | None = None
    last_slot: str = ""

    @classmethod
    def of(cls, tree: bpy.types.NodeTree) -> AnimationBefore:
        data = tree.animation_data
        if data is None:
            return cls(existed=False)
        slot = getattr(data, "action_slot", None)
        return cls(
            existed=True,
            action=data.action.name if data.action else None,
            slot=slot.identifier if slot else None,
            last_slot=getattr(data, "last_slot_identifier", ""),
        )

    def claim(self, tree: bpy.types.NodeTree) -> None:
        """Marks an action that ageing gave the tree, so that it is known to be ours later."""
        if self.action is None and tree.animation_data and tree.animation_data.action:
            tree.animation_data.action[TAG] = 1

    def restore(self, tree: bpy.types.NodeTree) -> None:
        """Puts back the action that was there; one of ours with nothing left in it goes."""
        data = tree.animation_data
        if data is None:
            return
        action = data.action
        if action is not None and TAG in action:
            now = _as_values(channels(tree))
            same = [
                each for each in _sources(action) if _as_values(_curves(each, self.slot)) == now
            ]
            if same or not len(channels(tree)):
                _assign(data, same[-1] if same else None, self.slot)
                _remove_unused(action)
            else:
                del action[TAG]  # the artist has changed it
        if hasattr(data, "last_slot_identifier") and data.action is None:
            data.last_slot_identifier = self.last_slot
        if not self.existed and not (data.action or data.drivers or data.nla_tracks):
            tree.animation_data_clear()


def _sources(action: bpy.types.Action) -> list[bpy.types.Action]:
    """What an action of ours was copied from, the nearest first."""
    held = action.get(TAG)
    return [held, *_sources(held)] if isinstance(held, bpy.types.Action) else []


def _remove_unused(action: bpy.types.Action) -> None:
    """Removes an action of ours that nothing uses, and those that it was copied from."""
    if TAG in action and user_count(action) == 0:
        sources = _sources(action)
        bpy.data.actions.remove(action)
        for each in sources[:1]:
            _remove_unused(each)


def own_action(tree: bpy.types.NodeTree, *, mark: bool = False) -> None:
    """Gives the tree a copy of an action that it shares, so that no other tree is touched.

    With `mark` the copy is known to be ours and holds what it was made of, which
    `AnimationBefore.restore` puts back.
    """
    data = tree.animation_data
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


def channels(block: bpy.types.NodeTree | bpy.types.Object) -> Sequence[bpy.types.FCurve]:
    """The F-curves that animate a block: Blender's own collection, or nothing."""
    data = block.animation_data
    if data is None or data.action is None:
        return ()
    slot = getattr(data, "action_slot", None)
    return _curves(data.action, slot.identifier if slot else None)


def _curves(action: bpy.types.Action, slot: str | None) -> Sequence[bpy.types.FCurve]:
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


def _as_values(curves: Sequence[bpy.types.FCurve]) -> list[tuple[object, ...]]:
    return [
        (curve.data_path, curve.array_index, point.interpolation, *point.co, *point.handle_right)
        for curve in curves
        for point in curve.keyframe_points
    ]


def key(
    socket: bpy.types.NodeSocket, values: Sequence[float | Sequence[float]], at: Sequence[float]
) -> None:
    """Keys `socket.default_value` to `values` at the frames `at`, straight from key to key."""
    for value, frame in zip(values, at, strict=True):
        socket.default_value = value
        socket.keyframe_insert("default_value", frame=frame)
    path = socket.path_from_id("default_value")
    for curve in channels(socket.id_data):
        if curve.data_path == path:
            for point in curve.keyframe_points:
                point.interpolation = "LINEAR"


def remove_keys(tree: bpy.types.NodeTree, path: str) -> None:
    """Takes away the F-curves of a property."""
    curves = channels(tree)
    for curve in [each for each in curves if each.data_path == path]:
        curves.remove(curve)


def drive_by_age(
    driven: bpy.types.bpy_struct,
    path: str,
    points: Sequence[tuple[int, float]],
    interpolation: Literal["CONSTANT", "LINEAR"],
    *,
    age: bpy.types.NodeSocket,
    last: int,
    material: bpy.types.Material,
) -> None:
    """Drives the property `path` of `driven` along a curve through `points`.

    A point is a modelled frame, from 0 at Age 0 to `last` at Age 1, and the value from there on or
    there.  The expression is a simple one: Blender evaluates it, and the curve, without Python, so
    it also works in a file whose scripts may not run.
    """
    curve = driven.driver_add(path)
    for modifier in list(curve.modifiers):
        curve.modifiers.remove(modifier)
    for frame, value in points:
        curve.keyframe_points.insert(frame, value).interpolation = interpolation
    driver = curve.driver
    variable = driver.variables.new()
    variable.name = "age"
    target = variable.targets[0]
    # By way of the material: a driver that names the node tree inside it forgets it in the file.
    target.id_type = "MATERIAL"
    target.id = material
    target.data_path = f"node_tree.{age.path_from_id('default_value')}"
    driver.type = "SCRIPTED"
    driver.expression = f"clamp(age) * {last}"
    assert driver.is_simple_expression
