"""What ageing changed in a material, kept in the material itself so that Revert can undo it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace

import bpy

from ..errors import MaterialError
from .animation import AnimationBefore
from .ownership import TAG
from .trace import input_socket, is_animated

__all__ = (
    "Link",
    "Record",
    "SocketBefore",
    "find",
    "is_aged",
    "keyed_sockets",
    "load",
    "store",
    "tagged",
)

_VERSION = 1


@dataclass(frozen=True)
class Link:
    """A link between two sockets, by the names of their nodes and their identifiers."""

    from_node: str
    from_socket: str
    to_node: str
    to_socket: str
    muted: bool = False

    @classmethod
    def of(cls, link: bpy.types.NodeLink) -> Link:
        return cls(
            link.from_node.name,
            link.from_socket.identifier,
            link.to_node.name,
            link.to_socket.identifier,
            link.is_muted,
        )


@dataclass(frozen=True)
class SocketBefore:
    """An input socket as it was: its link, and its own value, which lies hidden under a link.

    `animated` says that keys or drivers on it are the artist's.
    """

    node: str
    socket: str
    link: Link | None
    value: float | tuple[float, ...] | None = None
    animated: bool = False

    @classmethod
    def of(cls, socket: bpy.types.NodeSocket) -> SocketBefore:
        link = Link.of(socket.links[0]) if socket.links else None
        value = getattr(socket, "default_value", None)
        if hasattr(value, "__len__"):
            value = tuple(value)
        return cls(socket.node.name, socket.identifier, link, value, is_animated(socket))


@dataclass(frozen=True)
class Record:
    """Everything that ageing changed in a node tree besides the nodes it added, which are tagged.

        `links` are all links in their order, which Blender keeps and a restored link would lose.
    XX"""

    principled: str
    frames: int
    animation: AnimationBefore
    links: tuple[Link, ...]
    sockets: tuple[SocketBefore, ...] = field(default=())
    distribution: str | None = None
    age: str | None = None
    owner: AnimationBefore | None = None

    def with_socket(self, before: SocketBefore) -> Record:
        return replace(self, sockets=(*self.sockets, before))


def is_aged(material: bpy.types.Material) -> bool:
    """Whether the material shows an ageing that `revert` can take away."""
    return bool(material.tvbrdf.original)


def store(material: bpy.types.Material, record: Record) -> None:
    """Writes the record into the material."""
    material.tvbrdf.original = json.dumps({"version": _VERSION, **asdict(record)})


def load(material: bpy.types.Material) -> Record:
    """Reads the material's record; `MaterialError` where it is not one that can be understood."""
    try:
        data = json.loads(material.tvbrdf.original)
        if data.pop("version") != _VERSION:
            raise ValueError("version")
        animation = AnimationBefore(**data.pop("animation"))
        owner = AnimationBefore(**data["owner"]) if data.get("owner") else None
        links = tuple(Link(**each) for each in data.pop("links"))
        sockets = tuple(_socket(each) for each in data.pop("sockets"))
        data["owner"] = owner
        return Record(animation=animation, links=links, sockets=sockets, **data)
    except (ValueError, KeyError, TypeError) as error:
        raise MaterialError(
            f"What “{material.name}” was before ageing cannot be read ({error}).",
            "It may have been aged by a newer version of this extension: update it.",
        ) from error


def _socket(data: dict) -> SocketBefore:
    link = Link(**data.pop("link")) if data["link"] else data.pop("link")
    value = data.pop("value")
    return SocketBefore(link=link, value=tuple(value) if isinstance(value, list) else value, **data)


def tagged(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    """The nodes that ageing added."""
    return [node for node in tree.nodes if TAG in node]


def find(tree: bpy.types.NodeTree, before: SocketBefore) -> bpy.types.NodeSocket | None:
    """The socket that a record speaks of, or None if its node is gone."""
    node = tree.nodes.get(before.node)
    return input_socket(node, before.socket) if node else None


def keyed_sockets(tree: bpy.types.NodeTree, record: Record) -> list[bpy.types.NodeSocket]:
    """The sockets whose keys, if they have any, are ours."""
    ours = [
        socket
        for node in tagged(tree)
        for socket in (*node.inputs, *node.outputs)
        if hasattr(socket, "default_value")
    ]
    values = (each for each in record.sockets if each.value is not None and not each.animated)
    taken = (find(tree, each) for each in values)
    return [*ours, *(socket for socket in taken if socket is not None)]
