"""What lies in crevices, on edges and under the sky, as Cycles sees it: three bakes in one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ...known import image_texture, known
from ..reading.cycles import Baker
from .collect import Around
from .parts import Part
from .standing import BAKED, NORMAL, UV_MAP, smoothed, standing

__all__ = ("Shelter", "shelter")

Array = NDArray[np.float32]

# Of the size of the objects: how far crevices and edges reach; of all together: the sky's height.
_CREVICE, _EDGE, _SKY = 0.1, 0.02, 3.0
# Rays of a texel: samples of the bake times those of each node.
_SAMPLES, _RAYS = 2, 8


@dataclass(frozen=True)
class Shelter:
    """Maps [H, W], 0 to 1: `ao` 1 in the open and 0 in crevices, `edge` 0 on what is flat and 1 on
    edges, `sky` how much of it is seen; and where these were `baked`.
    """

    ao: Array
    edge: Array
    sky: Array
    baked: NDArray[np.bool_]


def shelter(
    parts: Sequence[Part], around: Sequence[Around], uv: Array, size: tuple[int, int]
) -> Shelter:
    """What the parts' triangles, laid out at `uv` [T, 3, 2], see of themselves and of all around,
    at the centers of a map's texels.  Raises `MaterialError` where Cycles fails.
    """
    corners = np.concatenate([part.faces.corners for part in parts])
    each = [np.linalg.norm(np.ptp(part.faces.corners, (0, 1))) for part in parts]
    single, whole = float(np.median(each)), float(np.linalg.norm(np.ptp(corners, (0, 1))))
    with standing(parts, around, uv) as (scene, obj, material):
        node = _emit(material, _CREVICE * single, _EDGE * single, _SKY * whole)
        baked = Baker(scene, obj, node, UV_MAP, 0).texels((0, 0), size, samples=_SAMPLES)
    there = baked.any(2)
    values = smoothed(((baked - BAKED) / (1 - BAKED)).clip(0, 1), there)
    # Of the rays into an edge of a right angle half meet the other side at once.
    return Shelter(values[..., 0], (2 - 2 * values[..., 1]).clip(0, 1), values[..., 2], there)


def _emit(
    material: bpy.types.Material, crevice: float, edge: float, sky: float
) -> bpy.types.ShaderNodeTexImage:
    """Lets a material emit what three nodes see as red, green and blue; its image to bake to."""
    tree = known(material.node_tree)
    tree.nodes.clear()

    def occlusion(distance: float, **settings: bool) -> bpy.types.Node:
        node = tree.nodes.new("ShaderNodeAmbientOcclusion")
        node.samples = _RAYS
        node.inputs["Distance"].default_value = distance
        for name, value in settings.items():
            setattr(node, name, value)
        return node

    normal = tree.nodes.new("ShaderNodeAttribute")
    normal.attribute_name = NORMAL
    up = tree.nodes.new("ShaderNodeCombineXYZ")
    up.inputs["Z"].default_value = 1.0
    combined = tree.nodes.new("ShaderNodeCombineXYZ")
    for socket, node, facing in zip(
        combined.inputs,
        (occlusion(crevice), occlusion(edge, inside=True, only_local=True), occlusion(sky)),
        (normal.outputs["Vector"], normal.outputs["Vector"], up.outputs[0]),
        strict=True,
    ):
        tree.links.new(facing, node.inputs["Normal"])
        tree.links.new(node.outputs["AO"], socket)
    moved = tree.nodes.new("ShaderNodeVectorMath")
    moved.operation = "MULTIPLY_ADD"
    moved.inputs[1].default_value = (1 - BAKED,) * 3
    moved.inputs[2].default_value = (BAKED,) * 3
    emission = tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(combined.outputs[0], moved.inputs[0])
    tree.links.new(moved.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    image = image_texture(tree.nodes.new("ShaderNodeTexImage"))
    tree.nodes.active = image
    return image
