"""Adds nodes to a tree: tagged, in one frame below the artist's own, left of the Principled."""

from __future__ import annotations

import bpy

from .ownership import TAG

__all__ = ("Layout",)

_COLUMN, _ROW = 300, 310
# Without a window no node has been drawn, so Blender knows no heights.
_HEIGHTS = {"BSDF_PRINCIPLED": 700, "TEX_IMAGE": 280, "MAPPING": 360, "VALTORGB": 240}
_SOCKET_HEIGHT = 22


class Layout:
    """The frame “Aged by tvbrdf” and the cells in it, columns counted from its right edge."""

    def __init__(self, tree: bpy.types.NodeTree, principled: bpy.types.Node) -> None:
        self._tree = tree
        others = [node for node in tree.nodes if node.type != "FRAME"]
        x, _ = _location(principled)
        self._right = x - 60
        self._top = min(_location(node)[1] - _height(node) for node in others) - 120
        self._frame = self._new("NodeFrame", "Aged by tvbrdf")
        self._frame.use_custom_color = True
        self._frame.color = (0.35, 0.2, 0.12)

    def add(self, kind: str, label: str, *, column: int, row: int) -> bpy.types.Node:
        """A tagged node of type `kind` named and labeled `label`."""
        node = self._new(kind, label)
        node.parent = self._frame
        node.location = (self._right - (column + 1) * _COLUMN, self._top - row * _ROW)
        return node

    def _new(self, kind: str, label: str) -> bpy.types.Node:
        node = self._tree.nodes.new(kind)
        node[TAG] = 1
        node.name = node.label = label
        node.select = False
        return node


def _location(node: bpy.types.Node) -> tuple[float, float]:
    """Where a node lies, its frames' own locations included."""
    x, y = node.location
    while node.parent is not None:
        node = node.parent
        x, y = x + node.location[0], y + node.location[1]
    return x, y


def _height(node: bpy.types.Node) -> float:
    if node.dimensions.y > 0:
        return node.dimensions.y
    sockets = sum(each.enabled and not each.hide for each in (*node.inputs, *node.outputs))
    return _HEIGHTS.get(node.type, 120 + _SOCKET_HEIGHT * sockets)
