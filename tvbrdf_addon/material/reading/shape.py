"""The relief of a material, where images beside those of its colors say it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy

from ....model_runtime.resampling import resize
from ...known import image_texture, known
from ..nodes.trace import input_socket, resolve, signature
from .pixels import image_pixels, write_exr
from .subject import Subject

__all__ = ("write_shape",)

_DEEPEST = 8  # Bump nodes in a row


def write_shape(subject: Subject, size: tuple[int, int], folder: Path) -> None:
    """Writes `Displacement.exr` and `Normal.exr` of the `size` of the other maps: those images that
    displace, bump or turn the normals of a material, and lie as those of its colors do.
    """
    if subject.space.kind != "texture":
        return
    for name, node in _shaping(subject).items():
        if _lies(node, subject) == _lies(subject.space.images[0], subject):
            pixels = image_pixels(known(node.image))[..., : 3 if name == "Normal" else 1]
            write_exr(folder / f"{name}.exr", resize(pixels, size))


def _shaping(subject: Subject) -> dict[str, bpy.types.ShaderNodeTexImage]:
    """What displaces goes before what bumps."""
    found: dict[str, bpy.types.ShaderNodeTexImage] = {}
    socket = subject.place.input("Normal")
    for _ in range(_DEEPEST):
        source = resolve(socket, subject.groups)
        node = known(source.node)
        if not source.is_output or node.type != "BUMP":
            break
        _note(found, "Displacement", node.inputs["Height"], subject.groups)
        socket = node.inputs["Normal"]
    if node.type == "NORMAL_MAP" and node.space == "TANGENT":
        _note(found, "Normal", node.inputs["Color"], subject.groups)
    displacing = known(resolve(subject.place.output.inputs["Displacement"]).node)
    if displacing.type == "DISPLACEMENT":
        _note(found, "Displacement", displacing.inputs["Height"], ())
    return found


def _note(
    found: dict[str, bpy.types.ShaderNodeTexImage],
    name: str,
    socket: bpy.types.NodeSocket,
    groups: Sequence[bpy.types.Node],
) -> None:
    source = resolve(socket, groups)
    if source.is_output and source.node.type == "TEX_IMAGE" and source.node.image is not None:
        found[name] = image_texture(source.node)


def _lies(node: bpy.types.Node, subject: Subject) -> tuple[object, ...]:
    return signature(input_socket(node, "Vector"), subject.groups)
