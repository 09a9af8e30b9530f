"""Objects that are more than a mesh: modifiers, geometry nodes, painted attributes."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

NAME = "Wear"


def modified(obj: bpy.types.Object, kind: str, **settings: object) -> bpy.types.Modifier:
    modifier = obj.modifiers.new(kind, kind)
    for name, value in settings.items():
        setattr(modifier, name, value)
    return modifier


def with_nodes(
    obj: bpy.types.Object,
    build: Callable[[bpy.types.NodeTree, bpy.types.NodeSocket], bpy.types.NodeSocket],
) -> None:
    """Gives `obj` geometry nodes; `build` makes of the geometry that comes in that which leaves."""
    group = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for side in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=side, socket_type="NodeSocketGeometry")
    begin, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    group.links.new(build(group, begin.outputs[0]), end.inputs[0])
    modified(obj, "NODES", node_group=group)


def paint(
    obj: bpy.types.Object, color, *, kind: str = "FLOAT_COLOR", domain: str = "POINT", name=NAME
) -> None:
    """Gives the mesh an attribute; `color` makes a number or a color of the vertex's place."""
    mesh = obj.data
    attribute = mesh.color_attributes.new(name, kind, domain)
    vertices = (
        range(len(mesh.vertices)) if domain == "POINT" else [x.vertex_index for x in mesh.loops]
    )
    for element, vertex in zip(attribute.data, vertices, strict=True):
        rgb = np.broadcast_to(color(*mesh.vertices[vertex].co), 3)
        element.color = (*rgb, 1.0)
