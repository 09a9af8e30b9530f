"""Follows node links backwards: what feeds a socket, and which nodes stand behind it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias

import bpy

from ...known import known, tree_of

__all__ = (
    "POINTWISE",
    "SOCKETS",
    "Principled",
    "input_socket",
    "is_animated",
    "resolve",
    "signature",
    "upstream",
)

Principled: TypeAlias = bpy.types.ShaderNodeBsdfPrincipled

SOCKETS = {
    "BaseColor": "Base Color",
    "Metallic": "Metallic",
    "Roughness": "Roughness",
    "Specular": "Specular IOR Level",
    "IOR": "IOR",
    "SpecularTint": "Specular Tint",
}
"""The maps that are read, and the Principled sockets that they are read from."""

POINTWISE = frozenset(
    (
        *("MIX", "MIX_RGB", "MATH", "VECT_MATH", "VALTORGB", "RGBTOBW", "INVERT", "GAMMA"),
        *("BRIGHTCONTRAST", "HUE_SAT", "CURVE_RGB", "CURVE_FLOAT", "CURVE_VEC", "MAP_RANGE"),
        *("CLAMP", "RGB", "VALUE", "BLACKBODY", "WAVELENGTH", "SEPARATE_COLOR", "COMBINE_COLOR"),
        *("SEPRGB", "COMBRGB", "SEPHSV", "COMBHSV", "SEPXYZ", "COMBXYZ", "REROUTE"),
    )
)
"""Types of nodes whose output depends on nothing but their inputs: not on where the texel lies."""

_IGNORED_PROPERTIES = frozenset(p.identifier for p in bpy.types.Node.bl_rna.properties)


def input_socket(node: bpy.types.Node, identifier: str) -> bpy.types.NodeSocket:
    """The input of `node` with that identifier, which unlike its index is the same everywhere."""
    return next(socket for socket in node.inputs if socket.identifier == identifier)


def resolve(
    socket: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node] = ()
) -> bpy.types.NodeSocket:
    """The socket whose value an input really shows, through reroutes and muted nodes and links.

    `groups` are the group nodes that `socket` lies in, the outermost first: what comes from
    outside of one is followed out of it.  Returns an output socket of a working node, or an input
    socket (its own, or that of a group or a muted node on the way) whose `default_value` is the
    value.
    """
    while not socket.is_output:
        links = known(socket.links)
        link = next((each for each in links if not each.is_muted and each.is_valid), None)
        if link is None:
            return socket
        source = known(link.from_socket)
        node = source.node
        if node.type == "REROUTE" and node.inputs[0].is_linked:
            socket = node.inputs[0]
        elif node.type == "GROUP_INPUT" and (outside := _outside(source, groups)) is not None:
            socket = outside
        elif node.mute:
            through = [each for each in node.internal_links if each.to_socket == source]
            if not through:
                return source
            socket = known(through[0].from_socket)
        else:
            return source
    return socket


def _outside(
    source: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node]
) -> bpy.types.NodeSocket | None:
    """The input of the group node that an output of a Group Input shows; None where it has none."""
    group = next((each for each in groups if each.node_tree == source.id_data), None)
    inputs = group.inputs if group is not None else ()
    return next((each for each in inputs if each.identifier == source.identifier), None)


def upstream(
    socket: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node] = ()
) -> Iterator[tuple[bpy.types.Node, str]]:
    """Every working node behind an input, groups entered, each with the name of the output used.

    `groups` are the group nodes that `socket` lies in, the outermost first.  A node inside a group
    that stands behind it twice may be met twice.
    """
    seen: set[tuple[int, str, tuple[int, ...]]] = set()

    def walk(
        at: bpy.types.NodeSocket, groups: tuple[bpy.types.Node, ...]
    ) -> Iterator[tuple[bpy.types.Node, str]]:
        source = resolve(at)
        if not source.is_output:
            return
        node = known(source.node)
        depth = tuple(group.as_pointer() for group in groups)
        key = (node.as_pointer(), source.identifier, depth)
        if key in seen:
            return
        seen.add(key)
        if node.type == "GROUP_INPUT":
            if groups:
                yield from walk(input_socket(groups[-1], source.identifier), groups[:-1])
            return
        yield node, source.name
        if node.type == "GROUP" and node.node_tree and len(groups) < 32:
            inner = [n for n in node.node_tree.nodes if n.type == "GROUP_OUTPUT"]
            for end in inner:
                if end.is_active_output:
                    yield from walk(input_socket(end, source.identifier), (*groups, node))
            return
        for each in node.inputs:
            yield from walk(each, groups)

    yield from walk(socket, tuple(groups))


def signature(
    socket: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node] = ()
) -> tuple[object, ...]:
    """What an image's Vector input is fed with, as a value: equal for equal mappings.

    An unlinked Vector, Texture Coordinate's UV and a UV Map node without a name are the same thing.
    `groups` are the group nodes that it lies in, the outermost first.
    """
    source = resolve(socket, groups)
    if not source.is_output:
        if source == socket and socket.node.type == "TEX_IMAGE":
            return ("uv", "")
        value = source.default_value
        return ("value", tuple(value) if hasattr(value, "__len__") else value)
    node = known(source.node)
    if node.type == "UVMAP" and not node.from_instancer:
        return ("uv", node.uv_map)
    if node.type == "TEX_COORD" and source.name == "UV" and not node.from_instancer:
        return ("uv", "")
    if node.type in ("GROUP", "GROUP_INPUT") or is_animated(node):
        return (node.name, source.identifier)
    settings = tuple(
        (p.identifier, str(getattr(node, p.identifier)))
        for p in node.bl_rna.properties
        if p.identifier not in _IGNORED_PROPERTIES and p.type not in ("POINTER", "COLLECTION")
    )
    objects = (getattr(node, "object", None), getattr(node, "image", None))
    names = tuple(each.name_full if each else "" for each in objects)
    inputs = tuple(signature(each, groups) for each in node.inputs if each.enabled)
    return (node.type, source.identifier, settings, names, inputs)


def is_animated(at: bpy.types.Node | bpy.types.NodeSocket) -> bool:
    """Whether keys or drivers move a node's settings, or a socket's value."""
    data = at.id_data.animation_data
    if data is None:
        return False
    from .animation import channels

    prefix = at.path_from_id()
    curves = [*channels(tree_of(at)), *data.drivers]
    return any(
        curve.data_path == prefix or curve.data_path.startswith((prefix + ".", prefix + "["))
        for curve in curves
    )
