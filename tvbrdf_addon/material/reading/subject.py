"""What a material says that is read: its sockets, and what these show without a bake."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...errors import MaterialError
from ...known import image_texture, known, tree_of
from ..nodes.animation import channels
from ..nodes.groups import own_groups
from ..nodes.surface import Place, find_principled
from ..nodes.trace import SOCKETS, resolve, upstream
from .onset import is_painted
from .pixels import Array, linear_color, luminance, write_exr
from .space import Space, choose_space, image_size, is_constant, is_direct

__all__ = ("Subject", "write_maps")

# That the worker takes.
_MOST = {"Specular": 100.0, "IOR": 1000.0, "SpecularTint": 100.0}
_MOST_OF_A_COLOR = 65504.0


@dataclass(frozen=True)
class Subject:
    """A material as it was before any aging, at a frame.

    `copy` is that, and may be changed; `material` is the artist's.  `sockets` are those of its
    Principled BSDF at `place`, by the names of their maps.
    """

    material: bpy.types.Material
    copy: bpy.types.Material
    scene: bpy.types.Scene
    frame: int
    place: Place
    space: Space
    sockets: dict[str, bpy.types.NodeSocket]

    @classmethod
    def of(
        cls,
        material: bpy.types.Material,
        copy: bpy.types.Material,
        scene: bpy.types.Scene,
        frame: int,
    ) -> Subject:
        """Makes the groups that the Principled BSDF of `copy` lies in its own.

        Raises `MaterialError` where an image cannot be loaded.
        """
        place = own_groups(find_principled(copy))
        space = choose_space(place.principled, place.groups, painted=is_painted(material))
        sockets = {name: place.input(each) for name, each in SOCKETS.items()}
        subject = cls(material, copy, scene, frame, place, space, sockets)
        for node, _ in subject.behind:
            _check_image(node)
        return subject

    @property
    def groups(self) -> tuple[bpy.types.Node, ...]:
        return self.place.groups

    @property
    def behind(self) -> list[tuple[bpy.types.Node, str]]:
        """The nodes that the sockets are computed from, with the names of their outputs."""
        return [pair for each in self.sockets.values() for pair in upstream(each, self.groups)]

    @property
    def shown(self) -> dict[str, bpy.types.ShaderNodeTexImage]:
        """The images that sockets show and nothing else, where maps are made in their space."""
        if self.space.kind != "texture":
            return {}
        return {
            name: image_texture(resolve(socket, self.groups).node)
            for name, socket in self.sockets.items()
            if is_direct(socket, self.groups)
        }

    def constants(self) -> dict[str, Array]:
        """The maps of a single texel: of the sockets that have one value all over."""
        return {
            name: _constant(socket, self.frame, self.groups)
            for name, socket in self.sockets.items()
            if is_constant(socket, self.groups)
        }

    def images(self) -> dict[str, Array]:
        """The maps of the images that are shown as they are; not of those whose alpha Cycles mixes
        into their color, its own way.
        """
        found = {}
        for name, node in self.shown.items():
            alpha_is_used = known(node.outputs)["Alpha"].is_linked
            color = linear_color(known(node.image), alpha_is_used=alpha_is_used)
            if color is not None:
                found[name] = _converted(self.sockets[name], color)
        return found


def _check_image(node: bpy.types.Node) -> None:
    if node.type not in ("TEX_IMAGE", "TEX_ENVIRONMENT") or node.image is None:
        return
    image = node.image
    if min(image_size(image)) == 0:  # asking for the size loads it, if it can be
        raise MaterialError(
            f"The image “{image.name}” cannot be loaded from {image.filepath or 'nowhere'}.",
            "Use File > External Data > Find Missing Files, or choose another image.",
        )


def _constant(socket: bpy.types.NodeSocket, frame: int, groups: Sequence[bpy.types.Node]) -> Array:
    source = resolve(socket, groups)
    value = np.atleast_1d(np.array(_value_at(source, frame), np.float32))
    return _converted(socket, value[:3].reshape(1, 1, -1))


def _value_at(source: bpy.types.NodeSocket, frame: int) -> list[float]:
    """A socket's value at a frame: its F-curves there, and elsewhere what it shows now."""
    value = source.default_value
    values = list(value) if hasattr(value, "__len__") else [value]
    path = source.path_from_id("default_value")
    for curve in channels(tree_of(source)):
        if curve.data_path == path and not curve.mute:
            values[curve.array_index] = curve.evaluate(frame)
    return values


def _converted(socket: bpy.types.NodeSocket, pixels: Array) -> Array:
    """Colors [H, W, 3] for color sockets, numbers [H, W] for others, as Cycles converts them."""
    if socket.type == "RGBA":
        return np.broadcast_to(pixels, (*pixels.shape[:2], 3))
    return luminance(pixels)


def write_maps(folder: Path, maps: Mapping[str, Array]) -> None:
    """Writes `BaseColor.exr`, ... with the values that the Principled BSDF really uses: it clamps
    what it is given.  Raises `MaterialError` for those that are no numbers, or too large.
    """
    for name, pixels in maps.items():
        write_exr(folder / f"{name}.exr", _bounded(name, pixels))


def _bounded(name: str, pixels: Array) -> Array:
    if not np.isfinite(pixels).all():
        raise MaterialError(
            f"The {SOCKETS[name]} of the material is not a number in places.",
            "Look for a division by zero or a broken image among its nodes.",
        )
    if name in ("Metallic", "Roughness"):
        return np.clip(pixels, 0, 1)
    most = _MOST.get(name, _MOST_OF_A_COLOR)
    if pixels.max() > most:
        raise MaterialError(
            f"The {SOCKETS[name]} of the material is above {most:,.0f} in places.",
            "Lower what feeds it.",
        )
    return np.maximum(pixels, 1e-5 if name == "IOR" else 0)
