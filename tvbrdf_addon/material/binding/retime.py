"""Moves the keys of an aged material with the frames that it is to age over."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ...known import known
from ..nodes.animation import Animated, channels, own_action, property_path
from ..nodes.record import is_aged, keyed_sockets, load

__all__ = ("keyed_range", "retime")


def retime(material: bpy.types.Material, first: int, last: int) -> None:
    """Lets aging begin on frame `first` and end on `last`; keys between keep their shares.

    Does nothing to a material that is not aged, and where there are no such frames.
    """
    if not is_aged(material) or last <= first:
        return
    own_action(material, mark=True)
    own_action(known(material.node_tree), mark=True)
    for curve in _curves(material):
        points = curve.keyframe_points
        start, end = points[0].co.x, points[-1].co.x
        if start == end:
            continue
        scale = (last - first) / (end - start)
        for point in points:
            for place in (point.co, point.handle_left, point.handle_right):
                place.x = first + (place.x - start) * scale
        curve.update()
    material.tvbrdf.keyed = first, last
    material.node_tree.update_tag()


def keyed_range(material: bpy.types.Material) -> tuple[float, float] | None:
    """The first and last frame with a key of aging; None without keys."""
    curves = list(_curves(material))
    if not curves:
        return None
    return (
        min(curve.keyframe_points[0].co.x for curve in curves),
        max(curve.keyframe_points[-1].co.x for curve in curves),
    )


def _curves(material: bpy.types.Material) -> Iterator[bpy.types.FCurve]:
    """Those of the age, and of sockets that are keyed themselves."""
    record, tree = load(material, material.name), known(material.node_tree)
    sockets = keyed_sockets(tree, record)
    ours: dict[Animated, set[str]] = {
        tree: {socket.path_from_id("default_value") for socket in sockets}
    }
    ours[material] = {property_path(record.age)} if record.age else set()
    for owner, paths in ours.items():
        yield from (curve for curve in channels(owner) if curve.data_path in paths)
