"""Keeps a material as old as it is on one frame: stills instead of sequences, no keys."""

from __future__ import annotations

import bpy

from ...errors import MaterialError
from ...known import known, tree_of
from ..nodes.age import as_age, hold_age
from ..nodes.animation import channels, own_action, remove_keys
from ..nodes.groups import require_ungrouped
from ..nodes.record import is_aged, keyed_sockets, load, require_local, sequences, tagged
from ..nodes.trace import input_socket

__all__ = ("freeze",)

_IN_TREE = "node_tree."


def freeze(material: bpy.types.Material, frame: int) -> None:
    """Leaves `material` as it looks on `frame`; Revert still restores the original.

    A texture remains of every map: that of the frame, or, between two, one that is packed into the
    file.  Age keeps its value of that frame, without keys, and moves nothing any more; where it
    was deleted, what is shown now stays.  Of what the shader ages, `live.freeze` makes stills.
    Raises `MaterialError`, with the material as it is, where it is not aged, another file has it,
    its record is lost, or a texture is missing.
    """
    if not is_aged(material):
        raise MaterialError(f"“{material.name}” is not aged.", "Age it first.")
    require_local(material)
    # Only now: numpy, which it needs, has no part in starting Blender.
    from .still import Fade, show, still

    record, tree = load(material, material.name), known(material.node_tree)
    require_ungrouped(tree, material.name)
    last = record.frames - 1
    offsets = {
        node: round(_driven(node.image_user, "frame_offset", frame, last))
        for node in sequences(tree)
    }
    stills = {node: still(known(node.image), offset + 1) for node, offset in offsets.items()}
    mixes = [
        (node, input_socket(node, "Factor_Float")) for node in tagged(tree) if node.type == "MIX"
    ]
    fades = [
        Fade.of(node, _driven(factor, "default_value", frame, last), stills)
        for node, factor in mixes
        if not factor.is_linked  # by the view
    ]
    own_action(tree, mark=True)
    if record.age is not None:
        hold_age(material, record.age, frame)
    for socket in keyed_sockets(tree, record):
        _hold(socket, frame)
    for node, offset in offsets.items():
        node.image_user.driver_remove("frame_offset")
        node.image_user.frame_offset = offset
        show(node, stills[node])
    for fade in fades:
        fade.end(tree)
    tree.update_tag()


def _hold(socket: bpy.types.NodeSocket, frame: int) -> None:
    """Gives a socket the value that its keys have on `frame`, and removes them."""
    tree, path = tree_of(socket), socket.path_from_id("default_value")
    curves = [curve for curve in channels(tree) if curve.data_path == path]
    value = socket.default_value
    for curve in curves:
        if hasattr(value, "__len__"):
            value[curve.array_index] = curve.evaluate(frame)
        else:
            socket.default_value = curve.evaluate(frame)
    remove_keys(tree, path)


def _driven(driven: bpy.types.bpy_struct, name: str, frame: int, last: int) -> float:
    """The value that the driver of a property has on `frame`, where Age 1 is the modeled frame
    `last`; without one, or without the Age that it follows, the value now.
    """
    now = getattr(driven, name)
    animation = driven.id_data.animation_data
    curve = animation.drivers.find(driven.path_from_id(name)) if animation else None
    age = _age(curve.driver, frame) if curve is not None else None
    if age is None:
        return now
    return curve.evaluate(age * last)


def _age(driver: bpy.types.Driver, frame: int) -> float | None:
    """The Age that a driver of ours follows, as its keys have it on `frame`; None if it is gone."""
    variable = driver.variables.get("age")
    target = variable.targets[0] if variable is not None else None
    if target is None or not isinstance(target.id, bpy.types.Material):
        return None
    owner, path, without = target.id, target.data_path, 0.0  # as a render has it
    if path.startswith(_IN_TREE):  # of 0.1
        owner, path, without = owner.node_tree, path.removeprefix(_IN_TREE), None
    try:
        now = owner.path_resolve(path)
    except ValueError:
        return without
    curve = next((each for each in channels(owner) if each.data_path == path), None)
    return as_age(now if curve is None else curve.evaluate(frame))
