"""Takes an ageing away: the material is again what the artist made."""

from __future__ import annotations

import bpy

from .age import take_age
from .animation import own_action, remove_keys
from .ownership import remove_groups, remove_images
from .record import Link, Record, find, is_aged, keyed_sockets, load, tagged
from .trace import input_socket

__all__ = ("is_aged", "revert")


def revert(material: bpy.types.Material) -> None:
    """Restores the material from its record; what the artist changed since elsewhere in it stays.

    Does nothing to a material that is not aged.  Raises `MaterialError` where the record cannot be
    read.
    """
    if not is_aged(material):
        return
    record = load(material)
    tree = material.node_tree
    own_action(tree)
    _remove_animation(tree, record)
    _remove_nodes(tree)
    _restore_sockets(tree, record)
    _restore_link_order(tree, record)
    record.animation.restore(tree)
    material.tvbrdf.property_unset("original")
    if record.age and record.owner:
        take_age(material, record.age, record.owner)
    tree.update_tag()


def _remove_animation(tree: bpy.types.NodeTree, record: Record) -> None:
    for node in tagged(tree):
        if node.type == "TEX_IMAGE":
            node.image_user.driver_remove("frame_offset")
        elif node.type == "VALUE":
            node.outputs[0].driver_remove("default_value")
        elif node.type == "MIX":
            input_socket(node, "Factor_Float").driver_remove("default_value")
    for socket in keyed_sockets(tree, record):
        remove_keys(tree, socket.path_from_id("default_value"))


def _remove_nodes(tree: bpy.types.NodeTree) -> None:
    images, groups = set(), set()
    for node in tagged(tree):
        if node.type == "TEX_IMAGE":
            images.add(node.image)
        elif node.type == "GROUP":
            groups.add(node.node_tree)
        tree.nodes.remove(node)
    remove_groups(groups)
    remove_images(images)


def _restore_sockets(tree: bpy.types.NodeTree, record: Record) -> None:
    for before in record.sockets:
        socket = find(tree, before)
        if socket is None:
            continue
        for link in list(socket.links):
            tree.links.remove(link)
        if before.value is not None:
            socket.default_value = before.value
        if before.link:
            _relink(tree, before.link)
    principled = tree.nodes.get(record.principled)
    if principled and record.distribution:
        principled.distribution = record.distribution


def _relink(tree: bpy.types.NodeTree, link: Link) -> None:
    source, target = tree.nodes.get(link.from_node), tree.nodes.get(link.to_node)
    if source is None or target is None:
        return
    output = next((s for s in source.outputs if s.identifier == link.from_socket), None)
    if output is not None:
        made = tree.links.new(output, input_socket(target, link.to_socket))
        made.is_muted = link.muted


def _restore_link_order(tree: bpy.types.NodeTree, record: Record) -> None:
    """Links restored lie at the end of the tree's list; puts them back between the others."""
    now = [Link.of(link) for link in tree.links]
    if now == list(record.links) or sorted(map(str, now)) != sorted(map(str, record.links)):
        return
    start = next(i for i, (a, b) in enumerate(zip(now, record.links, strict=True)) if a != b)
    for link in list(tree.links)[start:]:
        tree.links.remove(link)
    for link in record.links[start:]:
        _relink(tree, link)
