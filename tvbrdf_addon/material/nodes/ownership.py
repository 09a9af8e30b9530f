"""Marks what aging adds to a file, and counts who uses it."""

from __future__ import annotations

from collections.abc import Iterable

import bpy

__all__ = ("GROUP", "TAG", "remove_groups", "remove_images", "user_count")

TAG = "tvbrdf"
"""The custom property that marks what is ours: nodes, images, actions."""

GROUP = "tvbrdf_group"
"""That of our node groups; of one that materials share it says which."""


def user_count(data: bpy.types.ID) -> int:
    """How many data-blocks use this one, a fake user not among them.

    Counted anew: Blender 4.2 counts twice what a copied material uses.
    """
    return len(bpy.data.user_map(subset=[data])[data])


def remove_images(images: Iterable[bpy.types.Image | None]) -> None:
    """Removes those of our images that nothing shows."""
    for image in images:
        if image is not None and TAG in image and user_count(image) == 0:
            bpy.data.images.remove(image)


def remove_groups(groups: Iterable[bpy.types.NodeTree | None]) -> None:
    """Removes those of our groups that nothing shows, and what is in them."""
    for group in groups:
        if group is None or GROUP not in group or user_count(group):
            continue
        inner = {node.node_tree for node in group.nodes if node.type == "GROUP"}
        images = {node.image for node in group.nodes if node.type == "TEX_IMAGE"}
        bpy.data.node_groups.remove(group)
        remove_groups(inner)
        remove_images(images)
