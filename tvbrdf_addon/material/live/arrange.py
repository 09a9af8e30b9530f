"""Arranges a node group so that it reads from left to right: frames, and the nodes in each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import bpy

__all__ = ("arrange",)

_GAP, _BETWEEN, _LINE = 40, 110, 22
# Widths and heights by type: without a window none has been drawn, so Blender knows no sizes.
_WIDTHS = {"VALTORGB": 240, "TEX_IMAGE": 240, "GROUP": 220}
_HEIGHTS = {"VALTORGB": 230, "TEX_IMAGE": 290, "ATTRIBUTE": 170, "GROUP": 300}
_WIDTH, _COLLAPSED = 140, 46

_Pairs = Iterable[tuple[bpy.types.Node | None, bpy.types.Node | None]]


def arrange(tree: bpy.types.NodeTree) -> None:
    """Puts every frame one column right of the last one that feeds it, and nodes in it likewise.

    Those that were added first lie on top.
    """
    nodes = list(tree.nodes)
    frames = [node for node in nodes if node.type == "FRAME"]
    links = [(link.from_node, link.to_node) for link in tree.links]
    places: dict[bpy.types.Node, tuple[float, float]] = {}
    left = 0.0
    for column in _columns(frames, [(a.parent, b.parent) for a, b in links]):
        top = right = 0.0
        for frame in column:
            inside = [node for node in nodes if node.parent == frame]
            width, height = _lay_out(_columns(inside, links), left, top, places)
            right, top = max(right, width), top - height - _BETWEEN
        left += right + _BETWEEN
    # At once: after each of them Blender would ask what that changes in the file.
    locations = [at for node in nodes for at in places.get(node, node.location)]
    tree.nodes.foreach_set("location", locations)


def _lay_out(
    columns: list[list[bpy.types.Node]],
    left: float,
    top: float,
    places: dict[bpy.types.Node, tuple[float, float]],
) -> tuple[float, float]:
    """Says in `places` where a frame's nodes lie; the width and height taken."""
    width = height = 0.0
    for column in columns:
        y = 0.0
        for node in sorted(column, key=lambda each: each.type != "GROUP_INPUT"):
            places[node] = (left + width, top - y)
            y += _height(node)
        width += max(_WIDTHS.get(node.type, _WIDTH) for node in column) + _GAP
        height = max(height, y)
    return width, height


def _columns(nodes: list[bpy.types.Node], links: _Pairs) -> list[list[bpy.types.Node]]:
    """The nodes by column, given in an order in which what feeds one comes before it."""
    feeders: dict[bpy.types.Node, set[bpy.types.Node]] = {node: set() for node in nodes}
    for source, target in links:
        if target in feeders and source in feeders and source != target:
            feeders[target].add(source)
    places: dict[bpy.types.Node, int] = {}
    columns: dict[int, list[bpy.types.Node]] = defaultdict(list)
    for node in nodes:
        places[node] = max((places[each] + 1 for each in feeders[node]), default=0)
        columns[places[node]].append(node)
    return [column for _, column in sorted(columns.items())]


def _height(node: bpy.types.Node) -> float:
    if node.hide:
        return _COLLAPSED
    shown = sum(not each.hide and each.enabled for each in (*node.inputs, *node.outputs))
    return _HEIGHTS.get(node.type, 50 + _LINE * shown)
