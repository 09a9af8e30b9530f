"""What aging changed in a material, kept in the material itself so that Revert can undo it."""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass, field, replace

import bpy

from ...errors import MaterialError
from ...known import known
from .animation import AnimationBefore
from .decode import decoded
from .ownership import GROUP, TAG
from .trace import is_animated

__all__ = (
    "Link",
    "Record",
    "SocketBefore",
    "find",
    "forget_names",
    "is_aged",
    "is_live",
    "keyed_sockets",
    "load",
    "node_called",
    "plays",
    "require_local",
    "sequences",
    "store",
    "tagged",
)

# 1 had no check sum.
_VERSION = 2
_NAME = "tvbrdf name"


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
            _name(known(link.from_node)),
            link.from_socket.identifier,
            _name(known(link.to_node)),
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
        if value is not None and hasattr(value, "__len__"):
            value = tuple(value)
        return cls(socket.node.name, socket.identifier, link, value, is_animated(socket))


@dataclass(frozen=True)
class Record:
    """Everything that aging changed in a node tree besides the nodes it added, which are tagged.

    `links` are all links in their order, which Blender keeps and a restored link would lose.
    `distribution` is the Principled's own, where it was changed.  `frames` is the number of files
    of each sequence.  `age` is the custom property that moves what is shown (None: nothing, or a
    node of 0.1), and `owner` the animation of the material before it had that.  `uv_map` was
    added to the meshes that show the material, for its timing.
    """

    principled: str
    frames: int
    animation: AnimationBefore
    links: tuple[Link, ...]
    sockets: tuple[SocketBefore, ...] = field(default=())
    distribution: str | None = None
    age: str | None = None
    owner: AnimationBefore | None = None
    uv_map: str | None = None

    def with_socket(self, before: SocketBefore) -> Record:
        return replace(self, sockets=(*self.sockets, before))


def is_aged(material: bpy.types.Material) -> bool:
    """Whether the material shows an aging that `revert` can take away."""
    return bool(material.tvbrdf.original)


def require_local(material: bpy.types.Material) -> None:
    """Raises `MaterialError` where another file says what the material is."""
    if material.library or material.override_library:
        raise MaterialError(
            f"“{material.name}” is linked from another file.",
            "Use Object > Relations > Make Local first, or change it in its own file.",
        )


def store(material: bpy.types.Material, record: Record) -> None:
    """Writes the record into the material, and into its nodes what they are called: an artist may
    rename them.
    """
    for node in material.node_tree.nodes:
        if TAG not in node:
            node[_NAME] = node.name
    text = json.dumps(asdict(record))
    head = {"version": _VERSION, "sum": zlib.crc32(text.encode())}
    material.tvbrdf.original = json.dumps({**head, **asdict(record)})


def load(material: bpy.types.Material, name: str) -> Record:
    """Reads the material's record; where it is not what was written `MaterialError` on `name`."""
    try:
        data = json.loads(material.tvbrdf.original)
        if not isinstance(data, dict):
            raise TypeError("no record")
        version = data.pop("version")
        if version not in (1, _VERSION):
            raise ValueError("version")
        wanted = data.pop("sum") if version == _VERSION else None
        if wanted is not None and zlib.crc32(json.dumps(data).encode()) != wanted:
            raise ValueError("changed by another program")
        return decoded(Record, data)
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise MaterialError(
            f"What “{name}” was before aging cannot be read ({error}).",
            "Update this extension if a newer one aged it; else append the material from an "
            "earlier save of the file.",
        ) from error


def tagged(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    """The nodes that aging added."""
    return [node for node in tree.nodes if TAG in node]


def sequences(tree: bpy.types.NodeTree) -> list[bpy.types.ShaderNodeTexImage]:
    """Those of them that play textures."""
    textures = (each for each in tagged(tree) if isinstance(each, bpy.types.ShaderNodeTexImage))
    return [node for node in textures if node.image and node.image.source == "SEQUENCE"]


def is_live(material: bpy.types.Material) -> bool:
    """Whether the shader ages the material.  Cheap: panels call it."""
    nodes = tagged(material.node_tree) if material.node_tree is not None else ()
    groups = (node.node_tree for node in nodes if node.type == "GROUP")
    return any(group is not None and group.get(GROUP) == 1 for group in groups)


def plays(material: bpy.types.Material) -> bool:
    """Whether the material shows textures that change over time: it is aged and not frozen."""
    tree = material.node_tree
    return is_aged(material) and tree is not None and bool(sequences(tree))


def _name(node: bpy.types.Node) -> str:
    return node.get(_NAME, node.name)


def node_called(tree: bpy.types.NodeTree, name: str) -> bpy.types.Node | None:
    """The node that had this name when the record was made, or None if it is gone."""
    return next((node for node in tree.nodes if _name(node) == name), None)


def forget_names(tree: bpy.types.NodeTree) -> None:
    """Takes the names out of the nodes again."""
    for node in tree.nodes:
        if _NAME in node:
            del node[_NAME]


def find(tree: bpy.types.NodeTree, before: SocketBefore) -> bpy.types.NodeSocket | None:
    """The socket that a record speaks of, or None if it is gone."""
    node = node_called(tree, before.node)
    inputs = node.inputs if node is not None else ()
    return next((each for each in inputs if each.identifier == before.socket), None)


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
