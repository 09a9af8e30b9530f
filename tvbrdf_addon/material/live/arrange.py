"""Arranges a node group so that it reads from left to right, frame after frame."""

from __future__ import annotations

from collections import defaultdict

import bpy

__all__ = ("arrange",)

_GAP, _BETWEEN, _LINE = 50, 90, 22
# Widths and heights by type: without a window none has been drawn, so Blender knows no sizes.
_WIDTHS = {"VALTORGB": 260, "TEX_IMAGE": 260, "GROUP": 220}
_HEIGHTS = {"VALTORGB": 220, "TEX_IMAGE": 260, "ATTRIBUTE": 170, "GROUP": 280, "VALUE": 90}
_WIDTH, _COLLAPSED = 150, 44


def arrange(tree: bpy.types.NodeTree) -> None:
    """Puts the frames in a row, in the order in which they were added; in each frame a node lies
    one column right of the last one that feeds it there.
    """
    left = 0.0
    for frame in (node for node in tree.nodes if node.type == "FRAME"):
        inside = [node for node in tree.nodes if node.parent == frame]
        left = _lay_out(tree, inside, left) + _BETWEEN


def _lay_out(tree: bpy.types.NodeTree, nodes: list[bpy.types.Node], left: float) -> float:
    """Lays out a frame's nodes from `left` on; where they end on the right."""
    columns: dict[int, list[bpy.types.Node]] = defaultdict(list)
    for node, column in _columns(tree, nodes).items():
        columns[column].append(node)
    for _, column in sorted(columns.items()):
        top = 0.0
        for node in column:
            node.location = (left, top)
            top -= _height(node)
        left += max(_WIDTHS.get(node.type, _WIDTH) for node in column) + _GAP
    return left


def _columns(tree: bpy.types.NodeTree, nodes: list[bpy.types.Node]) -> dict[bpy.types.Node, int]:
    feeders: dict[bpy.types.Node, list[bpy.types.Node]] = {node: [] for node in nodes}
    for link in tree.links:
        if link.to_node in feeders and link.from_node in feeders:
            feeders[link.to_node].append(link.from_node)
    columns: dict[bpy.types.Node, int] = {}
    for node in nodes:  # as they were added: what feeds a node comes before it
        columns[node] = max((columns[each] + 1 for each in feeders[node]), default=0)
    return columns


def _height(node: bpy.types.Node) -> float:
    if node.hide:
        return _COLLAPSED
    shown = sum(not each.hide and each.enabled for each in (*node.inputs, *node.outputs))
    return _HEIGHTS.get(node.type, 60 + _LINE * shown) + _GAP / 2
