"""One texture in the place of two that play and fade into each other."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...errors import MaterialError
from ...known import known
from ..nodes.ownership import TAG, user_count
from ..nodes.trace import input_socket
from ..reading.pixels import Array, image_pixels, set_as_data

__all__ = ("Fade", "show", "still")


@dataclass(frozen=True)
class Fade:
    """A fade between two textures on the frame to keep: `mixed` is what it shows between them.

    `textures` are None where the artist has changed what fades.
    """

    node: bpy.types.Node
    factor: float
    textures: tuple[bpy.types.ShaderNodeTexImage, bpy.types.ShaderNodeTexImage] | None
    mixed: Array | None

    @classmethod
    def of(
        cls,
        node: bpy.types.Node,
        factor: float,
        stills: Mapping[bpy.types.ShaderNodeTexImage, str],
    ) -> Fade:
        sockets = (input_socket(node, name) for name in ("A_Color", "B_Color"))
        sources = [known(socket.links)[0].from_node for socket in sockets if socket.is_linked]
        images = (each for each in sources if isinstance(each, bpy.types.ShaderNodeTexImage))
        playing = [each for each in images if each.image is not None]
        ours = node.blend_type == "MIX" and all(TAG in each for each in playing)
        if len(playing) < 2 or not ours:
            return cls(node, factor, None, None)
        even, odd = playing
        if not 0 < factor < 1:
            return cls(node, factor, (even, odd), None)
        a, b = (_pixels(known(each.image), stills.get(each)) for each in playing)
        mixed = (1 - factor) * a + factor * b if a.shape == b.shape else None
        return cls(node, factor, (even, odd) if mixed is not None else None, mixed)

    def end(self, tree: bpy.types.NodeTree) -> None:
        """Leaves one texture of the two, or the fade as it is on the frame."""
        socket = input_socket(self.node, "Factor_Float")
        socket.driver_remove("default_value")
        socket.default_value = self.factor
        if self.textures is None:
            return
        seen, unseen = self.textures if self.factor < 1 else reversed(self.textures)
        if self.mixed is not None:
            _replace(seen, _packed(known(seen.image), self.mixed))
        result = next(each for each in self.node.outputs if each.identifier == "Result_Color")
        for link in list(known(result.links)):
            tree.links.new(known(seen.outputs)["Color"], known(link.to_socket))
        tree.nodes.remove(self.node)
        if not any(output.is_linked for output in known(unseen.outputs)):
            _replace(unseen, None)
            tree.nodes.remove(unseen)


def still(image: bpy.types.Image, number: int) -> str:
    """The path of one image of a sequence, whole where another file has the image."""
    path = re.sub(r"\d+(?=\.exr$)", f"{number:04d}", image.filepath)
    file = Path(bpy.path.abspath(path, library=image.library))
    if not file.is_file():
        raise MaterialError(
            f"The texture {file} is missing.",
            "Use File > External Data > Find Missing Files, or age the material again.",
        )
    return str(file) if image.library else path


def show(node: bpy.types.ShaderNodeTexImage, path: str) -> None:
    if user_count(known(node.image)) > 1 or node.image.library:  # a copy of the material plays it
        node.image = node.image.copy()
        node.image[TAG] = 1
    node.image.source = "FILE"
    node.image.filepath = path


def _replace(node: bpy.types.ShaderNodeTexImage, image: bpy.types.Image | None) -> None:
    """Gives a node another image; one of ours that nothing shows any more goes."""
    old, node.image = known(node.image), image
    if TAG in old and user_count(old) == 0:
        bpy.data.images.remove(old)


def _pixels(image: bpy.types.Image, path: str | None) -> Array:
    """The pixels [H, W, 4] of a texture of ours, or of the file at `path` that it is to show."""
    if path is None:
        return image_pixels(image)
    loaded = bpy.data.images.load(bpy.path.abspath(path, library=image.library))
    try:
        set_as_data(loaded)
        if min(loaded.size) == 0:
            raise MaterialError(f"The texture {path} is damaged.", "Age the material again.")
        return image_pixels(loaded)
    finally:
        bpy.data.images.remove(loaded)


def _packed(like: bpy.types.Image, pixels: Array) -> bpy.types.Image:
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(
        like.name, width, height, alpha=False, float_buffer=True, is_data=True
    )
    image[TAG] = 1
    image.alpha_mode = "NONE"
    image.use_half_precision = like.use_half_precision
    image.pixels.foreach_set(np.ascontiguousarray(pixels[::-1], np.float32).ravel())
    image.pack()
    return image
