"""Takes an aging away: the material is again what the artist made."""

from __future__ import annotations

import bpy

from ...errors import MaterialError
from ...known import known
from .age import take_age
from .animation import own_action, remove_keys
from .groups import originals_lost, require_ungrouped, restore_groups
from .ownership import remove_groups, remove_images
from .record import (
    Link,
    Record,
    find,
    forget_names,
    is_aged,
    keyed_sockets,
    load,
    node_called,
    require_local,
    tagged,
)
from .uv_maps import take_uv_map

__all__ = ("is_aged", "revert")


def revert(material: bpy.types.Material, *, owner: bpy.types.Material | None = None) -> None:
    """Restores the material from its record; what the artist changed since elsewhere in it stays.

    Where `material` is a temporary copy, `owner` is the material that it stands for.  Does nothing
    to a material that is not aged.  Raises `MaterialError`, with the material as it
    is, where the record or a node group is lost, and where another file has the material.
    """
    if not is_aged(material):
        return
    require_local(material)
    name = (owner or material).name
    record = load(material, name)
    _require_fitting(material, record, name)
    tree = known(material.node_tree)
    own_action(tree)
    _remove_animation(tree, record)
    _remove_nodes(tree)
    restore_groups(tree)
    _restore_sockets(tree, record)
    _restore_link_order(tree, record)
    record.animation.restore(tree)
    forget_names(tree)
    material.tvbrdf.property_unset("original")
    if record.uv_map:
        take_uv_map(record.uv_map)
    if record.age and record.owner:
        take_age(material, record.age, record.owner)
    tree.update_tag()


def _require_fitting(material: bpy.types.Material, record: Record, name: str) -> None:
    """Raises `MaterialError` where the record speaks of another tree than the material's."""
    tree = material.node_tree
    offered = bpy.types.ShaderNodeBsdfPrincipled.bl_rna.properties["distribution"].enum_items
    if (
        tree is None
        or not all(_fits(find(tree, each), each.value) for each in record.sockets)
        or record.distribution not in (None, *offered.keys())
    ):
        raise MaterialError(
            f"What “{name}” was before aging does not fit its nodes.",
            "Append the material from an earlier save of the file.",
        )
    require_ungrouped(tree, name)
    lost = originals_lost(tree)
    if lost:
        raise MaterialError(
            f"The node group that “{lost[0]}” was made of for “{name}” was deleted.",
            "Undo that, or append the group or the material from an earlier save of the file.",
        )


def _fits(socket: bpy.types.NodeSocket | None, value: float | tuple[float, ...] | None) -> bool:
    if socket is None or value is None:
        return True
    now = getattr(socket, "default_value", None)
    if isinstance(value, tuple):
        return now is not None and hasattr(now, "__len__") and len(now) == len(value)
    return isinstance(now, float) or type(now) is type(value)


def _remove_animation(tree: bpy.types.NodeTree, record: Record) -> None:
    for node in tagged(tree):
        if node.type == "TEX_IMAGE":
            node.image_user.driver_remove("frame_offset")
        for socket in (*node.inputs, *node.outputs):
            if hasattr(socket, "default_value"):
                socket.driver_remove("default_value")
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
        for link in list(known(socket.links)):
            tree.links.remove(link)
        if before.value is not None:
            socket.default_value = before.value
        if before.link:
            _relink(tree, before.link)
    principled = node_called(tree, record.principled)
    if principled is not None and record.distribution and principled.type == "BSDF_PRINCIPLED":
        principled.distribution = record.distribution


def _relink(tree: bpy.types.NodeTree, link: Link) -> None:
    source, target = node_called(tree, link.from_node), node_called(tree, link.to_node)
    if source is None or target is None:
        return
    output = next((s for s in source.outputs if s.identifier == link.from_socket), None)
    socket = next((s for s in target.inputs if s.identifier == link.to_socket), None)
    if output is not None and socket is not None:
        tree.links.new(output, socket).is_muted = link.muted


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
