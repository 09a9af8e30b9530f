"""Formulas written in Python that become math nodes.

canvas = Canvas(tree)
with canvas.stage("Local age"):
    age = canvas.number("Age") - onset
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeAlias

import bpy

from ..nodes.trace import input_socket

__all__ = (
    "Canvas",
    "Number",
    "Numeric",
    "Triple",
    "Vectorial",
    "dot",
    "greater",
    "less",
    "where",
    "where3",
)

# Numbers and vectors are many: they are collapsed, and read as a formula.
_COLLAPSED = ("MATH", "VECT_MATH", "MIX", "CLAMP", "SEPXYZ", "SEPARATE_COLOR")


@dataclass(frozen=True)
class Number:
    """A number that a node gives; arithmetic on it adds nodes."""

    canvas: Canvas
    socket: bpy.types.NodeSocket

    def __add__(self, other: Numeric) -> Number:
        return self.canvas.math("ADD", self, other)

    def __sub__(self, other: Numeric) -> Number:
        return self.canvas.math("SUBTRACT", self, other)

    def __rsub__(self, other: float) -> Number:
        return self.canvas.math("SUBTRACT", other, self)

    def __mul__(self, other: Numeric) -> Number:
        return self.canvas.math("MULTIPLY", self, other)

    def __truediv__(self, other: Numeric) -> Number:
        """0 where it is divided by 0."""
        return self.canvas.math("DIVIDE", self, other)

    def __rtruediv__(self, other: float) -> Number:
        return self.canvas.math("DIVIDE", other, self)

    def minimum(self, other: Numeric) -> Number:
        return self.canvas.math("MINIMUM", self, other)

    def maximum(self, other: Numeric) -> Number:
        return self.canvas.math("MAXIMUM", self, other)

    def clamp(self) -> Number:
        """At least 0 and at most 1."""
        return self.canvas.math("ADD", self, 0.0, clamp=True)

    def within(self, least: Numeric, most: Numeric) -> Number:
        """At least the one and at most the other, which is not below it: in one step, not two."""
        node = self.canvas.add("ShaderNodeClamp", self, least, most, clamp_type="MINMAX")
        return Number(self.canvas, node.outputs["Result"])

    def square(self) -> Number:
        return self * self

    def sqrt(self) -> Number:
        """0 of what is negative."""
        return self.canvas.math("SQRT", self)

    def scaled(self, factor: Numeric, offset: Numeric) -> Number:
        return self.canvas.math("MULTIPLY_ADD", self, factor, offset)


@dataclass(frozen=True)
class Triple:
    """A vector or a color that a node gives; arithmetic on it, channel by channel, adds nodes."""

    canvas: Canvas
    socket: bpy.types.NodeSocket

    def __add__(self, other: Vectorial) -> Triple:
        return self.canvas.vector_math("ADD", self, other)

    def __sub__(self, other: Vectorial | Numeric) -> Triple:
        return self.canvas.vector_math("SUBTRACT", self, other)

    def __mul__(self, other: Vectorial | Number) -> Triple:
        if isinstance(other, Number):
            return self.canvas.scale(self, other)
        return self.canvas.vector_math("MULTIPLY", self, other)

    def __truediv__(self, other: Vectorial) -> Triple:
        """0 where it is divided by 0."""
        return self.canvas.vector_math("DIVIDE", self, other)

    def minimum(self, other: Vectorial) -> Triple:
        return self.canvas.vector_math("MINIMUM", self, other)

    def maximum(self, other: Vectorial) -> Triple:
        return self.canvas.vector_math("MAXIMUM", self, other)

    def scaled(self, factor: Vectorial | Numeric, offset: Vectorial) -> Triple:
        return self.canvas.vector_math("MULTIPLY_ADD", self, factor, offset)

    def channels(self) -> tuple[Number, Number, Number]:
        node = self.canvas.add("ShaderNodeSeparateXYZ", self)
        red, green, blue = (Number(self.canvas, each) for each in node.outputs)
        return red, green, blue

    def least(self) -> Number:
        """Of the three channels."""
        red, green, blue = self.channels()
        return red.minimum(green).minimum(blue)

    def largest(self) -> Number:
        """Of the three channels, which HSV calls the value."""
        node = self.canvas.add("ShaderNodeSeparateColor", self, mode="HSV")
        return Number(self.canvas, node.outputs[2])


Numeric: TypeAlias = Number | float
Vectorial: TypeAlias = Triple | tuple[float, float, float]
_Given: TypeAlias = "Numeric | Vectorial"
_EMPTY: Mapping[str, Any] = MappingProxyType({})


def dot(a: Triple, b: Vectorial) -> Number:
    node = a.canvas.add("ShaderNodeVectorMath", a, b, operation="DOT_PRODUCT")
    return Number(a.canvas, node.outputs["Value"])


def greater(a: Numeric, b: Numeric) -> Number:
    """1 where `a` > `b`, else 0."""
    return _canvas_of(a, b).math("GREATER_THAN", a, b)


def less(a: Numeric, b: Numeric) -> Number:
    """1 where `a` < `b`, else 0."""
    return _canvas_of(a, b).math("LESS_THAN", a, b)


def where(share: Number, a: Numeric, b: Numeric) -> Number:
    """`a` where `share` is 1 and `b`, to the last bit, where it is 0."""
    return Number(share.canvas, share.canvas.mix("Float", share, b, a))


def where3(share: Number, a: Vectorial, b: Vectorial) -> Triple:
    """`where` for three channels."""
    return Triple(share.canvas, share.canvas.mix("Vector", share, b, a))


def _canvas_of(*values: Numeric) -> Canvas:
    return next(each.canvas for each in values if isinstance(each, Number))


class Canvas:
    """Adds nodes to a group, stage by stage; every stage has its frame."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self._tree = tree
        self._frame: bpy.types.Node | None = None
        self._entrance: bpy.types.Node | None = None

    @contextmanager
    def stage(self, label: str) -> Iterator[None]:
        """Puts what is added meanwhile into a frame with that label."""
        self._frame = self._tree.nodes.new("NodeFrame")
        self._frame.label = label  # a name would make Blender look through all animations
        self._frame.label_size = 24
        self._entrance = None
        yield
        self._frame = None

    def number(self, name: str) -> Number:
        """The group's own input of that name."""
        return Number(self, self._input(name))

    def triple(self, name: str) -> Triple:
        """The group's own input of that name, a color or a vector."""
        return Triple(self, self._input(name))

    def give(self, outputs: Mapping[str, Number | Triple]) -> None:
        """Links what the group gives, by the names of its outputs."""
        end = self.add("NodeGroupOutput", is_active_output=True)
        for name, value in outputs.items():
            self._tree.links.new(value.socket, end.inputs[name])

    def math(self, operation: str, *operands: Numeric, clamp: bool = False) -> Number:
        node = self.add("ShaderNodeMath", *operands, operation=operation, use_clamp=clamp)
        return Number(self, node.outputs["Value"])

    def vector_math(self, operation: str, *operands: _Given) -> Triple:
        node = self.add("ShaderNodeVectorMath", *operands, operation=operation)
        return Triple(self, node.outputs["Vector"])

    def scale(self, vector: Triple, factor: Number) -> Triple:
        node = self.add("ShaderNodeVectorMath", vector, operation="SCALE")
        self._feed(node.inputs["Scale"], factor)
        return Triple(self, node.outputs["Vector"])

    def mix(self, kind: str, share: Number, a: _Given, b: _Given) -> bpy.types.NodeSocket:
        node = self.add("ShaderNodeMix", data_type=kind.upper())
        for name, value in (("Factor_Float", share), (f"A_{kind}", a), (f"B_{kind}", b)):
            self._feed(input_socket(node, name), value)
        return next(each for each in node.outputs if each.identifier == f"Result_{kind}")

    def add(
        self, kind: str, *inputs: _Given, by_name: Mapping[str, _Given] = _EMPTY, **settings: object
    ) -> bpy.types.Node:
        """A node with those settings, whose first inputs are fed with `inputs`, others `by_name`:
        which place these have depends on Blender's version.
        """
        node = self._tree.nodes.new(kind)
        node.parent, node.select = self._frame, False
        for name, value in settings.items():
            setattr(node, name, value)
        node.hide = node.type in _COLLAPSED
        for socket, value in zip(node.inputs, inputs, strict=False):
            self._feed(socket, value)
        for name, value in by_name.items():
            self._feed(node.inputs[name], value)
        return node

    def _feed(self, socket: bpy.types.NodeSocket, value: _Given) -> None:
        if isinstance(value, (Number, Triple)):
            self._tree.links.new(value.socket, socket)
        else:
            spread = socket.type == "VECTOR" and isinstance(value, float)
            socket.default_value = (value,) * 3 if spread else value

    def _input(self, name: str) -> bpy.types.NodeSocket:
        """Of a Group Input in each stage, which shows what is used there."""
        if self._entrance is None:
            self._entrance = self.add("NodeGroupInput")
            for socket in self._entrance.outputs:
                socket.hide = True
        socket = self._entrance.outputs[name]
        socket.hide = False
        return socket
