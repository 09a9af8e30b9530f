"""How strong grain and relief are: inputs of the groups that age a material."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from .ownership import GROUP
from .record import tagged

__all__ = ("GRAIN", "RELIEF", "set_strengths", "strength")

GRAIN, RELIEF = "Grain", "Relief"


def strength(material: bpy.types.Material, name: str) -> float | None:
    """How strong `GRAIN` or `RELIEF` is; None where the nodes of a material have none.  Cheap."""
    return next((socket.default_value for socket in _inputs(material, name)), None)


def set_strengths(material: bpy.types.Material, *, grain: float, relief: float) -> None:
    """Lets an aged material show so much of both."""
    for name, value in ((GRAIN, grain), (RELIEF, relief)):
        for socket in _inputs(material, name):
            socket.default_value = value


def _inputs(material: bpy.types.Material, name: str) -> Iterator[bpy.types.NodeSocket]:
    for node in tagged(material.node_tree) if material.node_tree is not None else ():
        group = node.node_tree if node.type == "GROUP" else None
        if group is not None and GROUP in group and name in node.inputs:
            yield node.inputs[name]
