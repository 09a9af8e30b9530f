"""Keeps a material as old as it is on one frame: stills instead of sequences, no keys."""

from __future__ import annotations

import re
from pathlib import Path

import bpy

from ..errors import MaterialError
from .age import hold_age
from .animation import channels, own_action, remove_keys
from .ownership import TAG, user_count
from .record import is_aged, keyed_sockets, load, require_local, tagged
from .trace import input_socket

__all__ = ("freeze",)

_IN_TREE = "node_tree."


def freeze(material: bpy.types.Material, frame: int) -> None:
    """Leaves `material` as it looks on `frame`; Revert still restores the original.

    Age keeps its value of that frame, without keys, and moves nothing any more; where it was
    deleted, what is shown now stays.  Of what the shader ages, `live.freeze` makes stills instead.
    Raises `MaterialError`, with the material as it is, where it is not aged, another file has it,
    its record is lost, or a texture is missing.
    """
    if not is_aged(material):
        raise MaterialError(f"“{material.name}” is not aged.", "Age it first.")
    require_local(material)
    record, tree = load(material), material.node_tree
    textures = [node for node in tagged(tree) if node.type == "TEX_IMAGE"]
    played = [each for each in textures if each.image and each.image.source == "SEQUENCE"]
    last = record.frames - 1
    offsets = {
        node: round(_driven(node.image_user, "frame_offset", frame, last)) for node in played
    }
    stills = {node: _still(node.image, offset + 1) for node, offset in offsets.items()}
    fades = [input_socket(node, "Factor_Float") for node in tagged(tree) if node.type == "MIX"]
    factors = {fade: _driven(fade, "default_value", frame, last) for fade in fades}
    own_action(tree, mark=True)
    if record.age is not None:
        hold_age(material, record.age, frame)
    for socket in keyed_sockets(tree, record):
        _hold(socket, frame)
    for node, offset in offsets.items():
        node.image_user.driver_remove("frame_offset")
        node.image_user.frame_offset = offset
        _show(node, stills[node])
    for fade, factor in factors.items():
        fade.driver_remove("default_value")
        fade.default_value = factor
    tree.update_tag()


def _hold(socket: bpy.types.NodeSocket, frame: int) -> None:
    """Gives a socket the value that its keys have on `frame`, and removes them."""
    tree, path = socket.id_data, socket.path_from_id("default_value")
    curves = [curve for curve in channels(tree) if curve.data_path == path]
    for curve in curves:
        if hasattr(socket.default_value, "__len__"):
            socket.default_value[curve.array_index] = curve.evaluate(frame)
        else:
            socket.default_value = curve.evaluate(frame)
    remove_keys(tree, path)


def _driven(driven: bpy.types.bpy_struct, name: str, frame: int, last: int) -> float:
    """The value that the driver of a property has on `frame`, where Age 1 is the modelled frame
    `last`; without one, or without the Age that it follows, the value now.
    """
    now = getattr(driven, name)
    animation = driven.id_data.animation_data
    curve = animation.drivers.find(driven.path_from_id(name)) if animation else None
    age = _age(curve.driver, frame) if curve is not None else None
    if age is None:
        return now
    return curve.evaluate(min(max(age, 0.0), 1.0) * last)


def _age(driver: bpy.types.Driver, frame: int) -> float | None:
    """The Age that a driver of ours follows, as its keys have it on `frame`; None if it is gone."""
    variable = driver.variables.get("age")
    target = variable.targets[0] if variable is not None else None
    if target is None or not isinstance(target.id, bpy.types.Material):
        return None
    owner, path = target.id, target.data_path
    if path.startswith(_IN_TREE):  # of 0.1
        owner, path = owner.node_tree, path.removeprefix(_IN_TREE)
    for curve in channels(owner):
        if curve.data_path == path:
            return curve.evaluate(frame)
    try:
        return owner.path_resolve(path)
    except ValueError:
        return None


def _still(image: bpy.types.Image, number: int) -> str:
    """The path of one image of a sequence."""
    path = re.sub(r"\d+(?=\.exr$)", f"{number:04d}", image.filepath)
    file = Path(bpy.path.abspath(path, library=image.library))
    if not file.is_file():
        raise MaterialError(
            f"The texture {file} is missing.",
            "Use File > External Data > Find Missing Files, or age the material again.",
        )
    return path


def _show(node: bpy.types.ShaderNodeTexImage, path: str) -> None:
    image = node.image
    if user_count(image) > 1:  # a copy of the material plays it
        image = image.copy()
        image[TAG] = 1
        node.image = image
    image.source = "FILE"
    image.filepath = path
