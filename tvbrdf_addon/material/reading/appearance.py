"""What a material looks like on the whole, and what it is called: enough to tell what suits it.

Cheap but for images, of which each is looked at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import bpy
import numpy as np

from ....model_runtime.model_files.suits import Surface
from ...errors import MaterialError
from ..nodes.surface import find_principled
from ..nodes.trace import resolve, upstream
from .pixels import Array, linear_color
from .space import image_size

__all__ = ("surface_of",)

_SIDE = 64  # of what is left of an image
_MOST_TEXELS = 4096 * 4096  # a larger image would keep the panel waiting
_UNSEEN = 5e-4  # a change of brightness
_GRAY = (0.3, 0.3, 0.3)


class _Seen(NamedTuple):
    """Mean linear color of an image, and how many times as much it changes across its fibers."""

    color: tuple[float, float, float]
    fibers: float


_seen: dict[tuple[Any, ...], _Seen | None] = {}


def surface_of(material: bpy.types.Material) -> Surface:
    """What is known of `material`; of one without a Principled BSDF, its name."""
    names = (material.name,)
    if material.node_tree is None:
        return Surface(_GRAY, names=names)
    try:
        place = find_principled(material)
    except MaterialError:
        return Surface(_GRAY, names=names)
    color, *numbers = (place.input(each) for each in ("Base Color", "Metallic", "Roughness"))
    image, seen = _image_behind(color, place.groups)
    metallic, roughness = (_mean(socket, place.groups, 0.5)[0] for socket in numbers)
    return Surface(
        color=seen.color if seen is not None else _mean(color, place.groups),
        metallic=min(max(metallic, 0.0), 1.0),
        roughness=min(max(roughness, 0.0), 1.0),
        textured=seen is not None,
        fibers=seen.fibers if seen is not None else 1.0,
        names=names if image is None else (*names, image.name),
    )


def _image_behind(
    socket: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node]
) -> tuple[bpy.types.Image | None, _Seen | None]:
    """The image that feeds a socket, nearest first, and what was seen of it."""
    for node, _ in upstream(socket, groups):
        if isinstance(node, bpy.types.ShaderNodeTexImage) and node.image is not None:
            return node.image, _look_at(node.image)
    return None, None


def _mean(
    socket: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node], unknown: float = _GRAY[0]
) -> tuple[float, float, float]:
    """What a socket shows on the whole, as a color; `unknown` where that takes a bake to know."""
    source = resolve(socket, groups)
    if not source.is_output:
        return _color(source.default_value)
    _, seen = _image_behind(socket, groups)
    if seen is not None:
        channel = {"Red": 0, "Green": 1, "Blue": 2}.get(source.name)
        return seen.color if channel is None else _color(seen.color[channel])
    told = list(_told(socket, groups))
    return _color(np.mean(told, 0) if told else unknown)


def _told(
    socket: bpy.types.NodeSocket, groups: Sequence[bpy.types.Node]
) -> Iterator[tuple[float, float, float]]:
    """The colors that nodes behind a socket hold themselves."""
    for node, _ in upstream(socket, groups):
        if isinstance(node, bpy.types.ShaderNodeValToRGB):
            yield from (_color(element.color) for element in node.color_ramp.elements)
        elif node.type in ("RGB", "VALUE"):
            yield _color(node.outputs[0].default_value)


def _color(value: Any) -> tuple[float, float, float]:
    """A number or a color as one."""
    values = (
        [float(each) for each in value[:3]] if hasattr(value, "__len__") else [float(value)] * 3
    )
    return values[0], values[1], values[2]


def _look_at(image: bpy.types.Image) -> _Seen | None:
    """What is seen of an image; None of one that is none, or is too large to look at in passing."""
    if image.source not in ("FILE", "GENERATED", "TILED"):
        return None
    size = image_size(image)
    key = (image.session_uid, image.filepath, *size, image.colorspace_settings.name)
    if key not in _seen:
        many = size[0] * size[1]
        _seen[key] = _summed_up(image) if 0 < many <= _MOST_TEXELS else None
    return _seen[key]


def _summed_up(image: bpy.types.Image) -> _Seen | None:
    pixels = linear_color(image, alpha_is_used=True)
    if pixels is None:
        return None
    small = _smaller(pixels)
    light = np.sqrt(small.mean(-1).clip(0))
    steps = [float(np.abs(np.diff(light, axis=axis)).mean()) + _UNSEEN for axis in (0, 1)]
    return _Seen(_color(small.mean((0, 1))), max(steps) / min(steps))


def _smaller(pixels: Array) -> Array:
    """Means over squares, `_SIDE` along the shorter side; of a smaller image, itself."""
    height, width = pixels.shape[:2]
    step = max(min(height, width) // _SIDE, 1)
    rows, columns = height // step, width // step
    squares = pixels[: rows * step, : columns * step].reshape(rows, step, columns, step, 3)
    return squares.mean((1, 3))
