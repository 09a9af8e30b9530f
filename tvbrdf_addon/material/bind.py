"""Binds aged maps to a material: image sequences or keyed sockets, moved by one Age value."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import bpy

from ..errors import MaterialError
from .animation import TAG, AnimationBefore, drive_by_age, key, own_action
from .check import why_not
from .layout import Layout
from .pixels import read_exr_texel
from .read import Reading
from .record import Link, Record, SocketBefore, is_aged, store
from .result import AgedMap, AgedMaps, read_result
from .revert import revert
from .trace import find_principled, input_socket, is_animated

__all__ = ("bind",)

AUTHORED = {
    "base_color": "Base Color",
    "metallic": "Metallic",
    "specular": "Specular IOR Level",
    "roughness": "Roughness",
}
EXACT = {"base_color": "Base Color", "specular_tint": "Specular Tint", "roughness": "Roughness"}
# F0 = ((17.94 - 1) / (17.94 + 1))^2 = 0.8, which Specular Tint then scales to Ks.
EXACT_CONSTANTS = {"Metallic": 0.0, "IOR": 17.94, "Specular IOR Level": 0.5}


def bind(
    *,
    material: bpy.types.Material,
    reading: Reading,
    folder: Path,
    frame_start: int,
    frame_end: int,
) -> tuple[str, ...]:
    """Shows the result in `folder` (`aged.json` and its files) on `material`, over the frames.

    An earlier ageing is taken away first.  Nodes are only added and sockets relinked; the material
    keeps a record from which `revert` restores it.  Returns warnings.  Raises `MaterialError`, and
    then leaves the material as the artist made it.
    """
    if frame_end <= frame_start:
        raise MaterialError(
            f"The frame range {frame_start} to {frame_end} is empty.", "Choose a later last frame."
        )
    result = read_result(folder)
    _check(material)
    revert(material)
    binding = _Binding(material, reading, result, (frame_start, frame_end))
    try:
        binding.bind()
    except Exception:
        binding.store()
        revert(material)
        raise
    binding.store()
    return tuple(binding.warnings)


def _check(material: bpy.types.Material) -> None:
    if is_aged(material):
        return
    find = why_not(material, None)
    # Where there are no UVs is for `read` to say: the material may be on another object by now.
    if find and material.node_tree is None:
        raise MaterialError(find)


class _Binding:
    """One binding under way, and the record of what it has changed so far."""

    def __init__(
        self,
        material: bpy.types.Material,
        reading: Reading,
        result: AgedMaps,
        span: tuple[int, int],
    ) -> None:
        self.material = material
        self.warnings: list[str] = []
        self._reading = reading
        self._result = result
        self._tree = material.node_tree
        self._output, self._principled = find_principled(material)
        self._record = Record(
            principled=self._principled.name,
            frames=len(result.times),
            animation=AnimationBefore.of(self._tree),
            links=tuple(Link.of(link) for link in self._tree.links),
        )
        self._span = span
        self._rows = 0

    def store(self) -> None:
        self._record.animation.claim(self._tree)
        store(self.material, self._record)

    def bind(self) -> None:
        own_action(self._tree, mark=True)
        self._layout = Layout(self._tree, self._principled)
        age = self._layout.add("ShaderNodeValue", "Age", column=3, row=0)
        self._age = age.outputs[0]
        key(self._age, (0.0, 1.0), self._span)
        {
            "principled": self._bind_authored,
            "principled-exact": self._bind_exact,
            "torrance-sparrow": self._bind_torrance_sparrow,
        }[self._result.format]()

    def _bind_authored(self) -> None:
        for map in self._result.maps:
            if map.changes:
                socket = input_socket(self._principled, AUTHORED[map.name])
                self._show(map, self._taken(socket))

    def _bind_exact(self) -> None:
        if self._principled.distribution != "GGX":
            self._record = self._record.with_distribution(self._principled.distribution)
            self._principled.distribution = "GGX"
        for identifier, value in EXACT_CONSTANTS.items():
            self._taken(input_socket(self._principled, identifier)).default_value = value
        for map in self._result.maps:
            socket = input_socket(self._principled, EXACT[map.name])
            self._show(map, self._taken(socket))

    def _bind_torrance_sparrow(self) -> None:
        diffuse = self._layout.add("ShaderNodeBsdfDiffuse", "Diffuse", column=0, row=0)
        glossy = self._layout.add("ShaderNodeBsdfAnisotropic", "Specular", column=0, row=1)
        glossy.distribution = "GGX"
        both = self._layout.add("ShaderNodeAddShader", "Diffuse + Specular", column=-1, row=0)
        normal = input_socket(self._principled, "Normal")
        for shader, slot in zip((diffuse, glossy), both.inputs, strict=True):
            self._tree.links.new(shader.outputs[0], slot)
            if normal.is_linked:
                self._tree.links.new(normal.links[0].from_socket, shader.inputs["Normal"])
        targets = {"kd": diffuse.inputs["Color"], "ks": glossy.inputs["Color"]}
        for map in self._result.maps:
            if map.name == "alpha":
                self._show(map, glossy.inputs["Roughness"], math.sqrt)
            else:
                self._show(map, targets[map.name])
        surface = self._output.inputs["Surface"]
        self._remember(surface, value=False)
        self._tree.links.new(self._with_rest(both.outputs[0]), surface)
