"""Lets a material show heights: by its displacement where it has one, else by its normals."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import bpy

from ...known import known
from ..live.relief import displaced_group, relief_group
from ..nodes.strengths import RELIEF
from ..nodes.trace import resolve
from .edit import Edit

__all__ = ("Show", "with_relief")

Show: TypeAlias = Callable[[bpy.types.NodeSocket], None]
"""What lets a socket show something."""


def with_relief(edit: Edit, height: Show, distance: float) -> Show | None:
    """Shows what `height` lets a socket show, of which one is `distance` high in the world.

    Returns what lets a socket have the material's normal then; None where it keeps its own,
    because it is displaced.
    """
    displacement = edit.place.output.inputs["Displacement"]
    displaced = resolve(displacement).is_output
    node = edit.layout.add("ShaderNodeGroup", "Relief", column=-1, row=2)
    node.node_tree = displaced_group() if displaced else relief_group()
    node.inputs["Distance"].default_value = distance
    node.inputs[RELIEF].default_value = edit.material.tvbrdf.relief
    height(node.inputs["Height"])
    if displaced:
        for link in known(displacement.links):
            edit.tree.links.new(known(link.from_socket), node.inputs["Displacement"])
        edit.connect(node.outputs["Displacement"], displacement)
        return None
    _follow_normal(edit, node.inputs["Normal"])
    return partial(edit.connect, node.outputs["Normal"])


def _follow_normal(edit: Edit, socket: bpy.types.NodeSocket) -> None:
    """Feeds a socket with the artist's normal; without one with that of the surface, which only a
    shader's own Normal falls back to.
    """
    if any(not link.is_muted for link in known(edit.input("Normal").links)):
        edit.follow("Normal", socket)
        return
    surface = edit.layout.add("ShaderNodeNewGeometry", "Surface", column=1, row=1)
    edit.tree.links.new(known(surface.outputs)["Normal"], socket)
