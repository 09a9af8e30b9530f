"""Bakes what an object emits, and what light falls on it, with Cycles, in a scene of its own that
is gone afterwards.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np

from ...errors import MaterialError
from .passing import discard
from .pixels import Array, image_pixels
from .tiles import Tile

__all__ = ("Baker", "baking_scene")

_UV_MAP = "tvbrdf tile"
# Cycles' own samples of a texel lie in the quarter around its center: four bakes make all of it,
# all but a hair, as they lie some thousandths beside.
_QUARTER = 0.2475
_QUARTERS = tuple((_QUARTER * x, _QUARTER * y) for x in (-1, 1) for y in (-1, 1))


@contextmanager
def baking_scene(frame: int) -> Iterator[bpy.types.Scene]:
    scene = bpy.data.scenes.new("tvbrdf bake")
    try:
        if not hasattr(scene, "cycles"):
            raise MaterialError(
                "This material has to be baked, and Cycles is turned off.",
                "Enable Cycles Render Engine in Preferences > Add-ons.",
            )
        scene.render.engine = "CYCLES"
        scene.cycles.device = "CPU"
        scene.cycles.use_adaptive_sampling = False
        scene.cycles.use_denoising = False
        scene.render.bake.view_from = "ABOVE_SURFACE"
        scene.frame_current = frame
        yield scene
    finally:
        # Not scenes.remove, which crashes Blender (4.3) where there is no window: --command.
        bpy.data.batch_remove((scene,))


@dataclass(frozen=True)
class Baker:
    """Bakes `obj` of a baking scene by its `uv_map`; `node` is its material's active image node.

    Beside faces what is next to them goes on for `margin` texels. `lit`: what it scatters of direct
    light counts with what it emits.
    """

    scene: bpy.types.Scene
    obj: bpy.types.Object
    node: bpy.types.ShaderNodeTexImage
    uv_map: str
    margin: int
    lit: bool = False

    def texels(
        self,
        tile: Tile,
        size: tuple[int, int],
        *,
        margin: int | None = None,
        samples: int = 1,
        shift: tuple[float, float] = (0.0, 0.0),
    ) -> Array:
        """The texels [H, W, 3] of a tile of `size`: at their centers, moved by a `shift` in texels.

        Several samples lie around these.
        """
        self.scene.cycles.samples = samples
        corner = np.array(tile, np.float32) + np.array(shift, np.float32) / (size[1], size[0])
        with _image(size) as image:
            self.node.image = image
            _bake(
                self.scene,
                self.obj,
                self._uv_map_at(corner),
                self.margin if margin is None else margin,
                lit=self.lit,
            )
            return image_pixels(image)[..., :3]

    def mean(self, tile: Tile, size: tuple[int, int], samples: int) -> Array:
        """The mean [H, W, 3] over each texel of a tile, of so many samples."""
        total = np.zeros((*size, 3), np.float32)
        for seed, shift in enumerate(_QUARTERS):
            self.scene.cycles.seed = seed  # else all have the same noise
            total += self.texels(tile, size, samples=samples // len(_QUARTERS), shift=shift)
        return total / len(_QUARTERS)

    def _uv_map_at(self, corner: Array) -> str:
        """The UV map that has the square at `corner` at 0 to 1, which is where bakes go."""
        if not corner.any():
            return self.uv_map
        mesh = self.obj.data
        layer = mesh.uv_layers.get(_UV_MAP) or mesh.uv_layers.new(name=_UV_MAP, do_init=False)
        if layer is None:
            raise MaterialError(
                "The object has as many UV maps as it can have, and to bake needs another.",
                "Remove one under Object Data > UV Maps.",
            )
        uv = np.empty(len(mesh.loops) * 2, np.float32)
        mesh.uv_layers[self.uv_map].data.foreach_get("uv", uv)
        layer.data.foreach_set("uv", (uv.reshape(-1, 2) - corner).astype(np.float32).ravel())
        mesh.update()
        return layer.name


@contextmanager
def _image(size: tuple[int, int]) -> Iterator[bpy.types.Image]:
    height, width = size
    image = bpy.data.images.new(
        "tvbrdf bake", width, height, alpha=False, float_buffer=True, is_data=True
    )
    try:
        yield image
    finally:
        discard(image)


def _bake(
    scene: bpy.types.Scene, obj: bpy.types.Object, uv_map: str, margin: int, *, lit: bool
) -> None:
    view_layer = scene.view_layers[0]
    objects = [obj]
    try:
        with bpy.context.temp_override(
            scene=scene,
            view_layer=view_layer,
            object=obj,
            active_object=obj,
            selected_objects=objects,
            selected_editable_objects=objects,
        ):
            bpy.ops.object.bake(
                type="COMBINED" if lit else "EMIT",
                pass_filter={"EMIT", "DIRECT", "DIFFUSE"},
                target="IMAGE_TEXTURES",
                save_mode="INTERNAL",
                margin=margin,
                margin_type="EXTEND",
                use_clear=True,
                use_selected_to_active=False,
                use_cage=False,
                uv_layer=uv_map,
            )
    except RuntimeError as error:
        raise MaterialError(
            f"Cycles could not bake the material: {str(error).strip()}",
            "Try Object > Convert > Mesh on a copy of the object, or free memory.",
        ) from error
