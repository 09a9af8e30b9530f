"""Marks what aging adds to a file, counts who uses it, and removes it where nobody does."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import bpy

from ...known import by_uid

__all__ = ("GROUP", "TAG", "once_unread", "remove_groups", "remove_images", "user_count")

TAG = "tvbrdf"
"""The custom property that marks what is ours: nodes, images, actions."""

GROUP = "tvbrdf_group"
"""That of our node groups; of one that materials share it says which."""

_UNREAD_SECONDS = 4.0
_COLLECTIONS = {"IMAGE": "images", "NODETREE": "node_groups", "ACTION": "actions"}


def user_count(data: bpy.types.ID) -> int:
    """How many data-blocks use this one, a fake user not among them.

    Counted anew: Blender 4.2 counts twice what a copied material uses.
    """
    return len(bpy.data.user_map(subset=[data])[data])


def once_unread(remove: Callable[[Any], None], block: bpy.types.ID) -> None:
    """Calls `remove(block)`, which removes it if nothing uses it: in a window some seconds later.

    A thread of Blender's draws the icon of a material from a copy made two seconds before, which
    points to all that the material used then; to have that removed meanwhile crashes Blender 4.3.
    """
    if bpy.app.background:
        remove(block)
        return
    later = partial(_remove_unread, remove, _COLLECTIONS[block.id_type], block.session_uid)
    bpy.app.timers.register(later, first_interval=_UNREAD_SECONDS)


def _remove_unread(remove: Callable[[Any], None], collection: str, uid: int) -> float | None:
    if bpy.app.is_job_running("RENDER_PREVIEW"):
        return _UNREAD_SECONDS
    block = by_uid(getattr(bpy.data, collection), uid)
    if block is not None:
        remove(block)
    return None


def remove_images(images: Iterable[bpy.types.Image | None]) -> None:
    """Removes those of our images that nothing shows."""
    for image in images:
        if image is not None and TAG in image:
            once_unread(_remove_image, image)


def _remove_image(image: bpy.types.Image) -> None:
    if user_count(image) == 0:
        bpy.data.images.remove(image)


def remove_groups(groups: Iterable[bpy.types.NodeTree | None]) -> None:
    """Removes those of our groups that nothing shows, and what is in them."""
    for group in groups:
        if group is not None and GROUP in group:
            once_unread(_remove_group, group)


def _remove_group(group: bpy.types.NodeTree) -> None:
    if user_count(group):
        return
    inner = {node.node_tree for node in group.nodes if node.type == "GROUP"}
    images = {node.image for node in group.nodes if node.type == "TEX_IMAGE"}
    bpy.data.node_groups.remove(group)
    remove_groups(inner)
    remove_images(images)
