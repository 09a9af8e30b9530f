"""Arranges a node group so that it reads as a page does: frame after frame, line after line."""

from __future__ import annotations

from collections import defaultdict

import bpy

__all__ = ("arrange",)

_PAGE = 3000
"""How wide a line of frames may become."""

_GAP, _BETWEEN, _LINE = 40, 100, 22
# Widths and heights by type: without a window none has been drawn, so Blender knows no sizes.
_WIDTHS = {"VALTORGB": 240, "TEX_IMAGE": 240, "GROUP": 220}
_HEIGHTS = {"VALTORGB": 230, "TEX_IMAGE": 290, "ATTRIBUTE": 170, "GROUP": 300}
_WIDTH, _COLLAPSED = 140, 46


def arrange(tree: bpy.types.NodeTree) -> None:
    """Puts the frames in lines, in the order in which they were added; in each frame a node lies
    one column right of the last one that feeds it there.
    """
    left = top = lowest = 0.0
    for frame in [node for node in tree.nodes if node.type == "FRAME"]:
        inside = [node for node in tree.nodes if node.parent == frame]
        width, height = _lay_out(tree, inside)
        if left > 0 and left + width > _PAGE:
            left, top = 0.0, lowest - _BETWEEN
        for node in inside:
            node.location.x += left
            node.location.y += top
        left += width + _BETWEEN
        lowest = min(lowest, top - height)


def _lay_out(tree: bpy.types.NodeTree, nodes: list[bpy.types.Node]) -> tuple[float, float]:
    """Lays out a frame's nodes from (0, 0) to the right and down; the width and height taken."""
    columns: dict[int, list[bpy.types.Node]] = defaultdict(list)
    for node, column in _columns(tree, nodes).items():
        columns[column].append(node)
    width = height = 0.0
    for _, column in sorted(columns.items()):
        y = 0.0
        for node in sorted(column, key=lambda each: each.type != "GROUP_INPUT"):
            node.location = (width, y)
            y -= _height(node)
        width += max(_WIDTHS.get(node.type, _WIDTH) for node in column) + _GAP
        height = max(height, -y)
    return width, height


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
    return _HEIGHTS.get(node.type, 50 + _LINE * shown)
