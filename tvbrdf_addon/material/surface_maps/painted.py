"""What an artist painted on a surface, at the texels of its layout."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import bpy
import numpy as np
from numpy.typing import NDArray

from ....model_runtime.resampling import resize
from ...errors import MaterialError
from ..reading.pixels import in_file, luminance
from ..reading.space import image_size
from ..reading.unwrap import active_uv_map

if TYPE_CHECKING:
    from .collect import Seen
    from .layout import Layout

__all__ = ("Mask", "drawn")

Array = NDArray[np.float32]

_MOST_SIDE = 2048  # texels of an image that are looked up: maps of surfaces have no more


@dataclass(frozen=True)
class Mask:
    """A color attribute of the meshes, or an `image` that is looked up by their UV map `uv_map`
    where they have it, else by that which they render with.
    """

    attribute: str = ""
    image: bpy.types.Image | None = None
    uv_map: str = ""

    def at_corners(self, mesh: bpy.types.Mesh, *, but: str | None) -> Array | None:
        """Shades [L, 1] of all face corners, or where they lie in the image [L, 2] by any UV map
        `but` that one; None where the mesh has neither.
        """
        if self.image is not None:
            name = self.uv_map if self.uv_map in mesh.uv_layers else active_uv_map(mesh)
            if name in (None, but):
                return None
            places = np.empty(len(mesh.loops) * 2, np.float32)
            mesh.uv_layers[name].data.foreach_get("uv", places)
            return np.nan_to_num(places.reshape(-1, 2))
        attribute = mesh.color_attributes.get(self.attribute)
        if attribute is None or not len(attribute.data):
            return None
        colors = np.empty(len(attribute.data) * 4, np.float32)
        attribute.data.foreach_get("color", colors)
        shades = luminance(np.nan_to_num(colors.reshape(1, -1, 4)[..., :3]))[0, :, None]
        if attribute.domain == "CORNER":
            return shades
        vertices = np.empty(len(mesh.loops), np.int32)
        mesh.loops.foreach_get("vertex_index", vertices)
        return shades[vertices]

    def shades(self) -> Array | None:
        """The image's [h, w], 0 to 1, at most 2048 texels a side; None without one.  Raises
        `MaterialError` where it cannot be loaded.
        """
        if self.image is None:
            return None
        if min(image_size(self.image)) == 0:  # asking for the size loads it, if it can be
            raise MaterialError(
                f"The mask “{self.image.name}” cannot be loaded from "
                f"{self.image.filepath or 'nowhere'}.",
                "Use File > External Data > Find Missing Files, or choose another image.",
            )
        shades = np.nan_to_num(luminance(in_file(self.image))).clip(0, 1)
        height, width = (min(each, _MOST_SIDE) for each in shades.shape)
        return resize(shades, (height, width))

    def digest(self, seen: Seen, shades: Array | None) -> str:
        """Of all that its map is made from, but for the surface."""
        digest = hashlib.blake2b(digest_size=8)
        for each in (shades, *(shown.mesh.painted for shown in seen.shown)):
            digest.update(b"" if each is None else each.tobytes())
            digest.update(b"" if each is None else repr(each.shape).encode())
        return digest.hexdigest()

    def missing(self, seen: Seen) -> tuple[str, ...]:
        """A sentence where objects show nothing of it."""
        lacking = [each.obj.name for each in seen.shown if each.mesh.painted is None]
        if not lacking:
            return ()
        which = f"“{lacking[0]}” has" if len(lacking) == 1 else f"{len(lacking)} objects have"
        what = "UV map for the mask" if self.image is not None else f"mask “{self.attribute}”"
        return (f"{which} no {what}, which counts as black there.",)


def drawn(layout: Layout, shades: Array | None) -> Array:
    """What a mask shows at the layout's texels [H, W], 0 to 1: 0 where nothing is painted."""
    corners = [
        np.full((*part.faces.vertices.shape, 1 if shades is None else 2), np.nan, np.float32)
        if part.painted is None
        else part.painted
        for part in layout.seen.parts
    ]
    found = layout.raster.values(np.concatenate(corners))
    known = ~np.isnan(found[:, 0])
    found = found if shades is None else _looked_up(shades, np.nan_to_num(found))[:, None]
    return layout.raster.image(np.where(known[:, None], found, 0).clip(0, 1))[..., 0]


def _looked_up(shades: Array, uv: Array) -> Array:
    """What an image [h, w] that repeats shows at `uv` [n, 2]: linear between texels."""
    height, width = shades.shape
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    x, y = (x - left).astype(np.float32), (y - top).astype(np.float32)
    above, below, left, right = top % height, (top + 1) % height, left % width, (left + 1) % width
    upper = shades[above, left] * (1 - x) + shades[above, right] * x
    lower = shades[below, left] * (1 - x) + shades[below, right] * x
    return upper * (1 - y) + lower * y
