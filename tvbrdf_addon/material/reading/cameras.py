"""How large a material's textures need to be for the cameras of a scene."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import bpy
import numpy as np

from ...known import known
from .density import pixels_across
from .evaluated import in_view
from .onset import showing
from .passing import passing, stage
from .space import Space, image_size
from .spread import in_world, uv_mapping
from .unwrap import active_uv_map, triangles

__all__ = ("FULL", "LARGEST", "TextureSize", "all_the_cameras_see", "own_size")

FULL = 1024
"""Longer side, in pixels, of textures without images behind them, where nothing says another."""

LARGEST = 2048
"""The most that cameras can ask for where no image sets a bound."""

# Texels for a pixel, each way: at one, what is filtered twice is blurred, and between two frames
# that are looked at the camera may come nearer.
_SAFETY = 2.0
# A multiple of this, not a power of two: that would be up to four times the texels, and no renderer
# of Blender's asks for it.
_MULTIPLE = 64
# Images are shrunk only where half of the texels or more are saved: shrinking a little blurs a lot.
_WORTHWHILE = math.sqrt(0.5)
# Frames that are looked at.
_LOOKS = 16


@dataclass(frozen=True)
class TextureSize:
    """The longer side of the textures, in pixels, and why, in one sentence."""

    pixels: int
    why: str


class _UnknownError(Exception):
    """What cannot be told; its argument is the reason, the start of a sentence."""


def own_size(space: Space) -> int | None:
    """The longer side of the largest image, or tile of one, that a material is made of; None
    without images.
    """
    if space.kind != "texture":
        return None
    return max(max(image_size(known(node.image))) for node in space.images) or None


def all_the_cameras_see(
    material: bpy.types.Material,
    space: Space,
    scene: bpy.types.Scene,
    frames: tuple[int, int] | None,
    *,
    depsgraph: bpy.types.Depsgraph,
) -> TextureSize:
    """The size at which no camera of the scene sees the textures' texels.

    Over the scene's and the given `frames`, or, with None, now.  `depsgraph` is that of now.
    Nothing in the file is changed.  Where the cameras tell nothing, the full size: that of the
    largest image, or `FULL`.
    """
    own = own_size(space)
    most = own or LARGEST
    try:
        view = _View(material, space, scene)
        if _has_instances(material, depsgraph):
            raise _UnknownError(f"Instances show “{material.name}”")
        if frames is None:
            seen = view.pixels(depsgraph)
        else:
            seen = _over(view, _looks(scene, frames), most)
    except _UnknownError as reason:
        return TextureSize(own or FULL, f"{reason}, so the textures keep their full size.")
    if seen == 0:
        unseen = f"No camera sees “{material.name}”, so the textures keep their full size."
        return TextureSize(own or FULL, unseen)
    # A hair above a multiple is that multiple: rounding errors of single precision.
    wanted = max(1, math.ceil(_SAFETY * seen / _MULTIPLE - 1e-3)) * _MULTIPLE
    if own is not None and wanted > _WORTHWHILE * own:
        return TextureSize(own, f"The cameras see all {own} px of the images.")
    if wanted > most:
        return TextureSize(most, f"The cameras see more than {most} px: set a size to go further.")
    now = " on this frame" if frames is None else ""
    of = f", of {own} in the images" if own else ""
    return TextureSize(wanted, f"{wanted} px is all the cameras see{now}{of}.")


def _over(view: _View, frames: Iterable[int], most: int) -> float:
    """The most pixels over `frames`; looks no further where more than `most` are needed anyway."""
    seen = 0.0
    with passing() as made:
        scene = stage("tvbrdf cameras", [*view.cameras, *view.objects], made)
        for frame in frames:
            scene.frame_set(frame)
            seen = max(seen, view.pixels(known(scene.view_layers[0].depsgraph)))
            if _SAFETY * seen > most:
                break
    return seen


def _looks(scene: bpy.types.Scene, frames: tuple[int, int]) -> list[int]:
    """Frames to look at, the first and the last among them."""
    first, last = min(scene.frame_start, frames[0]), max(scene.frame_end, frames[1])
    count = min(_LOOKS, last - first + 1)
    return [round(first + i * (last - first) / max(count - 1, 1)) for i in range(count)]


class _View:
    """Who looks at what: `cameras` at the `objects` that show a material.

    Raises `_UnknownError` where that does not say how large the textures need to be.
    """

    def __init__(self, material: bpy.types.Material, space: Space, scene: bpy.types.Scene) -> None:
        self._material = material
        self.cameras = [obj for obj in scene.objects if obj.type == "CAMERA"]
        self.objects = [obj for obj in showing(material, scene) if not obj.hide_render]
        render = scene.render
        share = render.resolution_percentage / 100
        self._resolution = round(render.resolution_x * share), round(render.resolution_y * share)
        self._aspect = render.pixel_aspect_x, render.pixel_aspect_y
        found = uv_mapping(space)
        if found is None:
            raise _UnknownError(f"“{material.name}” is not looked up by UV")
        self._uv_map, self._mapping = found
        if not self.cameras:
            raise _UnknownError("There is no camera")
        if any(camera.data.type == "PANO" for camera in self.cameras):
            raise _UnknownError("A camera is panoramic")
        for obj in self.objects:
            if obj.type != "MESH":
                raise _UnknownError(f"“{obj.name}” is no mesh")

    def pixels(self, depsgraph: bpy.types.Depsgraph) -> float:
        """The most pixels that lie along the textures' unit square in any camera; 0 if unseen."""
        seen = 0.0
        clips = [self._projection(camera, depsgraph) for camera in self.cameras]
        for obj in self.objects:
            with in_view(obj, depsgraph) as (mesh, materials):
                uv_map = self._uv_map or active_uv_map(mesh)
                if uv_map is None or uv_map not in mesh.uv_layers:
                    raise _UnknownError(f"“{obj.name}” has no such UV map")
                slots = [each == self._material for each in materials]
                corners, uv = triangles(mesh, slots, uv_map)
            if not len(uv):
                continue
            corners = in_world(corners, obj, depsgraph)
            for clip, focal in clips:
                seen = max(seen, pixels_across(corners, uv @ self._mapping.T, clip, focal))
        return seen

    def _projection(self, camera: bpy.types.Object, depsgraph: bpy.types.Depsgraph):
        """From the world to clip space [4, 4], and the pixels that a length of 1 has at w = 1."""
        evaluated = camera.evaluated_get(depsgraph)
        (width, height), (aspect_x, aspect_y) = self._resolution, self._aspect
        projection = evaluated.calc_matrix_camera(
            depsgraph, x=width, y=height, scale_x=aspect_x, scale_y=aspect_y
        )
        # As the renderers do, without the camera object's scale.
        placed = evaluated.matrix_world.normalized()
        focal = max(projection[0][0] * width, projection[1][1] * height) / 2
        return np.array(projection @ placed.inverted()), focal


def _has_instances(material: bpy.types.Material, depsgraph: bpy.types.Depsgraph) -> bool:
    return any(
        instance.is_instance
        and any(slot.material == material for slot in instance.object.original.material_slots)
        for instance in depsgraph.object_instances
    )
