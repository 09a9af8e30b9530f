"""Where the Principled BSDF of a surface stands that ages: behind mixers, in node groups."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import bpy

from ...errors import MaterialError
from ...known import known, tree_of
from .ownership import TAG
from .trace import Principled, input_socket, is_animated, resolve

__all__ = ("Place", "find_principled", "why_not_in_eevee")

_NAMES = {
    "MIX_SHADER": "a Mix Shader",
    "ADD_SHADER": "an Add Shader",
    "GROUP": "a node group",
    "EMISSION": "an Emission shader",
    "BSDF_DIFFUSE": "a Diffuse BSDF",
    "BSDF_GLOSSY": "a Glossy BSDF",
}
_MIXES = ("MIX_SHADER", "ADD_SHADER", "GROUP")
_DEEPEST = 32  # groups in groups

_Groups = tuple[bpy.types.Node, ...]


@dataclass(frozen=True)
class Place:
    """Where the Principled BSDF of a material stands.

    `output` is the Material Output that shows it, `groups` are the group nodes that it lies in,
    the outermost first: none where it stands in the material's own tree.  `share` is how much of
    the surface it is as far as factors are constant; of others it is a half.
    """

    output: bpy.types.Node
    principled: Principled
    groups: tuple[bpy.types.Node, ...] = ()
    share: float = 1.0

    def input(self, identifier: str) -> bpy.types.NodeSocket:
        """An input of the Principled BSDF."""
        return input_socket(self.principled, identifier)

    @property
    def name(self) -> str:
        """What an artist calls it, and the groups that it lies in."""
        within = (f" in “{group.label or group.name}”" for group in reversed(self.groups))
        return f"“{self.principled.label or self.principled.name}”" + "".join(within)

    @property
    def path(self) -> str:
        """Which of a material's it is, for its settings."""
        return "\n".join(node.name for node in (*self.groups, self.principled))

    @property
    def beside(self) -> Sequence[Place]:
        """The others that the surface mixes with it: one is aged at a time."""
        working = (place for place in _principleds(self.output) if not place.principled.mute)
        return [place for place in working if place.path != self.path]

    @property
    def trees(self) -> tuple[bpy.types.NodeTree, ...]:
        """The trees on the way to it, the material's own first and its own last."""
        return (tree_of(self.output), *(group.node_tree for group in self.groups))


def find_principled(
    material: bpy.types.Material, *, owner: bpy.types.Material | None = None
) -> Place:
    """The Principled BSDF that the surface of `material` shows, in Cycles if it differs; of several
    the one that its settings name, else the first of those with the largest share.

    Where `material` is a temporary copy, `owner` is the material that it stands for.  Raises
    `MaterialError` where there is none.
    """
    name = f"“{(owner or material).name}”"
    tree = material.node_tree
    output = tree.get_output_node("CYCLES") or tree.get_output_node("EEVEE")
    if output is None:
        raise MaterialError(
            f"{name} has no Material Output:",
            "add one and connect a Principled BSDF to it.",
        )
    found = _principleds(output)
    if working := [place for place in found if not place.principled.mute]:
        chosen = material.tvbrdf.shader
        named = (place for place in working if place.path == chosen)
        return next(named, None) or max(working, key=lambda place: place.share)
    if found:
        raise MaterialError(f"The Principled BSDF of {name} is muted:", "unmute it.")
    wanted = "connect a Principled BSDF to the Material Output."
    source = resolve(output.inputs["Surface"])
    if not source.is_output:
        raise MaterialError(f"Nothing is connected to the surface of {name}:", wanted)
    if source.node.mute:
        shown = source.node.label or source.node.name
        raise MaterialError(f"“{shown}”, which is the surface of {name}, is muted:", "unmute it.")
    shows = _NAMES.get(source.node.type, f"the node {source.node.bl_label}")
    without = " without a Principled BSDF" if source.node.type in _MIXES else ""
    raise MaterialError(f"The surface of {name} is {shows}{without}, which cannot be aged:", wanted)


def why_not_in_eevee(place: Place) -> str | None:
    """One sentence where EEVEE shows a surface that does not age with `place`; else None."""
    other = place.output.id_data.get_output_node("EEVEE")
    if other is None or other == place.output:
        return None
    shaders = _shaders(other.inputs["Surface"])
    if any((node, groups) == (place.principled, place.groups) for node, groups, _ in shaders):
        return None
    return (
        f"In EEVEE the material stays as it is, because “{other.name}” shows another surface: "
        f"connect “{place.principled.name}” to it, too."
    )


def _principleds(output: bpy.types.Node) -> Sequence[Place]:
    """Those of the artist's: lobes of a measurement are ours."""
    return [
        Place(output, shader, groups, share)
        for shader, groups, share in _shaders(output.inputs["Surface"])
        if isinstance(shader, Principled) and TAG not in shader
    ]


def _shaders(surface: bpy.types.NodeSocket) -> Iterator[tuple[bpy.types.Node, _Groups, float]]:
    """The shaders that a surface is mixed of, each once, with the group nodes that they lie in and
    their share.
    """
    seen: set[tuple[int, ...]] = set()

    def walk(
        at: bpy.types.NodeSocket | None, groups: _Groups, share: float
    ) -> Iterator[tuple[bpy.types.Node, _Groups, float]]:
        source = resolve(at) if at is not None else None
        if source is None or not source.is_output:
            return
        node = known(source.node)
        key = (node.as_pointer(), source.as_pointer(), *(each.as_pointer() for each in groups))
        if key in seen:
            return
        seen.add(key)
        if node.type == "GROUP_INPUT":
            if groups:
                yield from walk(_like(groups[-1].inputs, source), groups[:-1], share)
        elif node.type == "GROUP":
            if node.node_tree is not None and not node.mute and len(groups) < _DEEPEST:
                for end in node.node_tree.nodes:
                    if end.type == "GROUP_OUTPUT" and end.is_active_output:
                        yield from walk(_like(end.inputs, source), (*groups, node), share)
        elif node.type == "MIX_SHADER":
            for socket, weight in _weighed(node, groups):
                yield from walk(socket, groups, weight * share)
        else:
            yield node, groups, share
            for socket in node.inputs:
                if socket.type == "SHADER":
                    yield from walk(socket, groups, share)

    yield from walk(surface, (), 1.0)


def _weighed(node: bpy.types.Node, groups: _Groups) -> Sequence[tuple[bpy.types.NodeSocket, float]]:
    """The shaders that a Mix Shader shows with their shares: both, or one where its factor is
    always 0 or 1.
    """
    factor, first, second = node.inputs
    source = resolve(factor, groups)
    constant = not source.is_output or source.node.type == "VALUE"
    share = 0.5
    if constant and source.type == "VALUE" and not is_animated(source):
        share = min(max(source.default_value, 0.0), 1.0)
    return [each for each in ((first, 1 - share), (second, share)) if each[1] > 0]


def _like(
    sockets: bpy.types.NodeInputs, wanted: bpy.types.NodeSocket
) -> bpy.types.NodeSocket | None:
    return next((each for each in sockets if each.identifier == wanted.identifier), None)
