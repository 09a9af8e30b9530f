"""A material's own copies of the node groups that its Principled BSDF lies in, and what goes in and
out of them.

A group may be used elsewhere, so that it is never changed: the material gets copies, of which each
holds its original until `restore_groups` puts that back.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal

import bpy

from ...errors import MaterialError
from .ownership import TAG, once_unread, user_count
from .surface import Place

__all__ = (
    "feed",
    "originals_lost",
    "own_groups",
    "owned_groups",
    "remove_unused",
    "require_ungrouped",
    "restore_groups",
    "shown_outside",
)

_PANEL = "Aged by tvbrdf"
_TYPES = {
    "VALUE": "NodeSocketFloat",
    "INT": "NodeSocketInt",
    "BOOLEAN": "NodeSocketBool",
    "VECTOR": "NodeSocketVector",
    "RGBA": "NodeSocketColor",
    "SHADER": "NodeSocketShader",
}


def own_groups(place: Place) -> Place:
    """Puts copies in the place of the groups that the Principled BSDF lies in; where it lies then.

    The copies are the material's own and may be changed.
    """
    tree, groups = place.output.id_data, []
    for group in place.groups:
        node = tree.nodes[group.name]
        original = node.node_tree
        copy = original.copy()
        copy[TAG] = original
        copy.use_fake_user = False
        copy.asset_clear()
        node.node_tree = copy
        groups.append(node)
        tree = copy
    return replace(place, principled=tree.nodes[place.principled.name], groups=tuple(groups))


def owned_groups(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    """The group nodes of a tree that show such a copy."""
    nodes = (node for node in tree.nodes if node.type == "GROUP" and node.node_tree is not None)
    return [node for node in nodes if TAG in node.node_tree]


def originals_lost(tree: bpy.types.NodeTree) -> list[str]:
    """The copies of which the artist deleted the original, by the names of their nodes."""
    return [
        node.name
        for node in owned_groups(tree)
        if not isinstance(node.node_tree[TAG], bpy.types.NodeTree)
    ]


def require_ungrouped(tree: bpy.types.NodeTree, name: str) -> None:
    """Raises `MaterialError`, about the material `name`, where an artist has put what aging added
    to its tree into a group.
    """
    for node in tree.nodes:
        inside = node.node_tree if node.type == "GROUP" else None
        if inside is not None and TAG not in inside and any(TAG in each for each in inside.nodes):
            raise MaterialError(
                f"What aging added to “{name}” is in the group “{node.label or node.name}”.",
                "Select it and use Group > Ungroup first.",
            )


def restore_groups(tree: bpy.types.NodeTree) -> None:
    """Puts the originals back in the place of the copies that a material's tree shows."""
    copies = []
    for node in owned_groups(tree):
        shown = node.node_tree
        copies.append(shown)
        if shown.library or user_count(shown) > 1:  # others still need what was added to it
            node.node_tree = shown.copy()
            copies.append(node.node_tree)
        _remove_added(node.node_tree)
        node.node_tree = shown[TAG]
    remove_unused(copies)


def _remove_added(copy: bpy.types.NodeTree) -> None:
    """Takes the sockets that aging added from a copy, and so from the nodes that show it.

    Blender 4.2.0 leaves them on a node that shows another group from then on, or whose group loses
    them with their panel.
    """
    panel = _panel(copy)
    if panel is not None:
        for item in [item for item in copy.interface.items_tree if item.parent == panel]:
            copy.interface.remove(item)
        copy.interface.remove(panel)


def remove_unused(copies: Iterable[bpy.types.NodeTree]) -> None:
    """Removes those of such copies that nothing shows, and the copies in them."""
    for copy in set(copies):
        once_unread(_remove_copy, copy)


def _remove_copy(copy: bpy.types.NodeTree) -> None:
    if user_count(copy) == 0:
        inner = [node.node_tree for node in owned_groups(copy)]
        bpy.data.node_groups.remove(copy)
        remove_unused(inner)


def feed(
    source: bpy.types.NodeSocket, socket: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node]
) -> None:
    """Links `source`, of the material's own tree, to a socket in one of its own `groups`."""
    depth = [group.node_tree for group in groups].index(socket.id_data)
    for group, shown in zip(groups, (*groups[1 : depth + 1], socket.node), strict=False):
        inside = group.node_tree
        identifier = _new_socket(inside, socket, "INPUT")
        group.id_data.links.new(source, _with(identifier, group.inputs))
        entrance = next((n for n in inside.nodes if n.type == "GROUP_INPUT" and TAG in n), None)
        if entrance is None:
            entrance = inside.nodes.new("NodeGroupInput")
            entrance[TAG] = 1
            entrance.parent, (x, y) = shown.parent, shown.location
            entrance.location = (x - 250, y - 400)
        source = _with(identifier, entrance.outputs)
    socket.id_data.links.new(source, socket)


def shown_outside(
    source: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node]
) -> bpy.types.NodeSocket:
    """An output of the outermost of the material's own `groups` that has what `source` has inside.

    A `source` in the material's own tree is itself that.
    """
    inside = [group.node_tree for group in groups]
    if source.id_data not in inside:
        return source
    for group in reversed(groups[: inside.index(source.id_data) + 1]):
        tree = group.node_tree
        identifier = _new_socket(tree, source, "OUTPUT")
        end = next(n for n in tree.nodes if n.type == "GROUP_OUTPUT" and n.is_active_output)
        tree.links.new(source, _with(identifier, end.inputs))
        source = _with(identifier, group.outputs)
    return source


def _new_socket(
    tree: bpy.types.NodeTree, like: bpy.types.NodeSocket, side: Literal["INPUT", "OUTPUT"]
) -> str:
    """The identifier of a socket added to a group, after all others: keys name these by number."""
    panel = _panel(tree)
    if panel is None:
        panel = tree.interface.new_panel(_PANEL, default_closed=True)
    made = tree.interface.new_socket(
        like.name, in_out=side, socket_type=_TYPES[like.type], parent=panel
    )
    return made.identifier


def _panel(tree: bpy.types.NodeTree) -> bpy.types.NodeTreeInterfacePanel | None:
    """The panel of a group that holds all that was added to it."""
    items = tree.interface.items_tree
    panels = (item for item in items if isinstance(item, bpy.types.NodeTreeInterfacePanel))
    return next((item for item in panels if item.name == _PANEL), None)


def _with(identifier: str, sockets: Iterable[bpy.types.NodeSocket]) -> bpy.types.NodeSocket:
    return next(each for each in sockets if each.identifier == identifier)
