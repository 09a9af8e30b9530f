"""How much light falls on a surface, as Cycles sees it: of the sun and the sky in a year, or of the
lights of the artist's scene.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import mathutils
import numpy as np
from numpy.typing import NDArray

from ...errors import MaterialError
from ...known import image_texture, known
from ..reading.cycles import Baker
from .collect import Around
from .parts import Part
from .standing import BAKED, NORMAL, UV_MAP, glows, smoothed, standing
from .sunlight import light_of_a_year

__all__ = ("Light", "light_on")

Array = NDArray[np.float32]

_SAMPLES, _GLOWING_SAMPLES = 48, 128  # of what glows each sees but a face
_MOST = 0.95  # of the surface has less light than that which counts as all
_LEAST = 1e-9


@dataclass(frozen=True)
class Light:
    """What lights a surface: the lights of a `scene`, its world and what glows, or without one the
    open sky at a `latitude`, with north at `north` (radians, as `light_of_a_year` has them).
    """

    scene: bpy.types.Scene | None
    latitude: float = 0.0
    north: float = 0.0

    @property
    def digest(self) -> str | None:
        """Of all that it depends on but the surface; None where that is not known."""
        if self.scene is not None:
            return None
        return hashlib.blake2b(
            repr((self.latitude, self.north)).encode(), digest_size=8
        ).hexdigest()


def light_on(
    light: Light,
    parts: Sequence[Part],
    around: Sequence[Around],
    uv: Array,
    size: tuple[int, int],
    frame: int,
) -> Array:
    """The light that falls on the parts' triangles, laid out at `uv` [T, 3, 2], at the texels of a
    map: [H, W], 1 where it is what the brightest have, and a little noisy; NaN where no face shows
    at the middle.

    Raises:
        MaterialError: Cycles fails, or no light falls on it.
    """
    glowing = light.scene is not None and any(map(glows, around))
    with (
        standing(parts, around, uv, frame, glowing=glowing) as (scene, obj, material),
        _lighting(light, scene),
    ):
        node = _scatter(material)
        baker = Baker(scene, obj, node, UV_MAP, 0, lit=True)
        samples = _GLOWING_SAMPLES if glowing else _SAMPLES
        baked = baker.texels((0, 0), size, samples=samples).mean(2)
    there = baked > BAKED / 2
    if not there.any():
        raise MaterialError(
            "Where light falls on the surface could not be baked.", "Choose another Light."
        )
    seen = (baked - BAKED).clip(0)
    most = np.quantile(smoothed(seen[..., None], there)[there], _MOST)
    if most < _LEAST:
        raise MaterialError(
            "No light of the scene falls on the surface.", "Add one, or choose another Light."
        )
    return np.where(there, seen / most, np.nan).astype(np.float32)


def _scatter(material: bpy.types.Material) -> bpy.types.ShaderNodeTexImage:
    """Lets a material scatter all light, and emit a little, which lights nothing; its image to bake
    to.
    """
    tree = known(material.node_tree)
    tree.nodes.clear()
    normal = tree.nodes.new("ShaderNodeAttribute")
    normal.attribute_name = NORMAL
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (BAKED, BAKED, BAKED, 1.0)
    # Else it would light itself where it is hollow, and be looked for as a lamp is.
    ray = tree.nodes.new("ShaderNodeLightPath")
    seen = tree.nodes.new("ShaderNodeMath")
    seen.operation = "SUBTRACT"
    seen.inputs[0].default_value = 1.0
    material.cycles.emission_sampling = "NONE"
    tree.links.new(ray.outputs["Is Diffuse Ray"], seen.inputs[1])
    tree.links.new(seen.outputs[0], emission.inputs["Strength"])
    both = tree.nodes.new("ShaderNodeAddShader")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(normal.outputs["Vector"], diffuse.inputs["Normal"])
    tree.links.new(diffuse.outputs[0], both.inputs[0])
    tree.links.new(emission.outputs[0], both.inputs[1])
    tree.links.new(both.outputs[0], output.inputs["Surface"])
    image = image_texture(tree.nodes.new("ShaderNodeTexImage"))
    tree.nodes.active = image
    return image


@contextmanager
def _lighting(light: Light, scene: bpy.types.Scene) -> Iterator[None]:
    """Lights a baking scene, as long as it lasts."""
    made: list[bpy.types.ID] = []
    try:
        if light.scene is None:
            scene.world = _sky(light_of_a_year(light.latitude, light.north), made)
        else:
            scene.world = light.scene.world
            for data, matrix in _lamps(light.scene):
                lamp = bpy.data.objects.new("tvbrdf look", data)
                made.append(lamp)
                lamp.matrix_world = matrix
                scene.collection.objects.link(lamp)
        yield
    finally:
        scene.world = None
        bpy.data.batch_remove(made)


def _lamps(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.ID, mathutils.Matrix]]:
    """The lights of a scene that are rendered, instances included, where they stand now."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    for each in depsgraph.object_instances:
        obj = known(each.object.original)
        if obj.type == "LIGHT" and not obj.hide_render and scene.objects.get(obj.name) == obj:
            yield known(obj.data), each.matrix_world.copy()


def _sky(radiance: Array, made: list[bpy.types.ID]) -> bpy.types.World:
    """A world that shines as a picture [H, W] of all around; it and what it needs are `made`."""
    height, width = radiance.shape
    image = bpy.data.images.new("tvbrdf look", width, height, float_buffer=True, is_data=True)
    world = bpy.data.worlds.new("tvbrdf look")
    made += [world, image]
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = radiance[..., None]
    image.pixels.foreach_set(pixels.ravel())
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    tree = known(world.node_tree)
    tree.nodes.clear()
    around = tree.nodes.new("ShaderNodeTexEnvironment")
    around.image = image
    background = tree.nodes.new("ShaderNodeBackground")
    output = tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(around.outputs["Color"], background.inputs["Color"])
    tree.links.new(background.outputs[0], output.inputs["Surface"])
    return world
