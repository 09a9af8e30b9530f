"""Keeps a material as old as it is on one frame: stills instead of sequences, no keys."""

from __future__ import annotations

import re

import bpy

from ..errors import MaterialError
from .animation import channels, own_action, remove_keys
from .ownership import TAG, user_count
from .record import is_aged, keyed_sockets, load, tagged
from .trace import input_socket

__all__ = ("freeze",)


def freeze(material: bpy.types.Material, frame: int) -> None:
    """Leaves `material` as it looks on `frame`; Revert still restores the original.

    Age keeps its value of that frame, without keys, and moves nothing any more.  Raises
    `MaterialError` where the material is not aged.
    """
    if not is_aged(material):
        raise MaterialError(f"“{material.name}” is not aged.", "Age it first.")
    record, tree = load(material), material.node_tree
    own_action(tree, mark=True)
    nodes = tagged(tree)
    age = next((n for n in nodes if n.type == "VALUE" and n.label == "Age"), None)
    sockets = keyed_sockets(tree, record)
    for socket in sockets:
        _hold(socket, frame)
    place = min(max(age.outputs[0].default_value, 0.0), 1.0) * (record.frames - 1)
    for node in nodes:
        if node.type == "TEX_IMAGE" and node.image and node.image.source == "SEQUENCE":
            _take_driven(node.image_user, "frame_offset", place)
            _still(node, node.image_user.frame_offset + 1)
        elif node.type == "MIX":
            _take_driven(input_socket(node, "Factor_Float"), "default_value", place)
    tree.update_tag()


def _hold(socket: bpy.types.NodeSocket, frame: int) -> None:
    """Gives a socket the value that its keys have on `frame`, and removes them."""
    tree, path = socket.id_data, socket.path_from_id("default_value")
    curves = [curve for curve in channels(tree) if curve.data_path == path]
    if not curves:
        return
    if hasattr(socket.default_value, "__len__"):
        for curve in curves:
            socket.default_value[curve.array_index] = curve.evaluate(frame)
    else:
        socket.default_value = curves[0].evaluate(frame)
    remove_keys(tree, path)


def _take_driven(driven: bpy.types.bpy_struct, name: str, place: float) -> None:
    """Gives a property the value that its driver has with Age at the modelled frame `place`, and
    removes the driver; one that has none stays.
    """
    path = driven.path_from_id(name)
    curve = driven.id_data.animation_data.drivers.find(path)
    if curve is not None:
        setattr(driven, name, type(getattr(driven, name))(curve.evaluate(place)))
        driven.driver_remove(name)


def _still(node: bpy.types.ShaderNodeTexImage, number: int) -> None:
    image = node.image
    if user_count(image) > 1:  # a copy of the material plays it
        image = image.copy()
        image[TAG] = 1
        node.image = image
    image.source = "FILE"
    image.filepath = re.sub(r"\d+(?=\.exr$)", f"{number:04d}", image.filepath)
