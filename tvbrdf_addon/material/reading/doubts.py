"""What is lost in reading a material, or may surprise: a sentence each."""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ....model_runtime.contract import EVERYWHERE
from ..nodes.surface import Place, why_not_in_eevee
from ..nodes.trace import is_animated, resolve, upstream
from .bake import Target
from .evaluated import Evaluated
from .onset import showing
from .pixels import Array
from .space import Space, choose_space, looked_up_by
from .tiles import Tiles
from .unwrap import active_uv_map, flat_share, overlaps, shows, squares

__all__ = ("baked_badly", "lacking", "lost", "shared", "surprising", "unwrapped_badly")

_NAMED = 5  # tiles in a sentence

# A smaller part, as the rims that Solidify makes, lies on a line of what is beside it.
_FLAT = 0.5

_VIEW_NODES = ("FRESNEL", "LAYER_WEIGHT", "CAMERA", "LIGHT_PATH", "SHADERTORGB")
_VIEW_OUTPUTS = ("Incoming", "Camera", "Window", "Reflection", "Parametric", "Backfacing")
# Nodes, or outputs of them, that say something else for each object that shows the same mesh.
_OF_THE_OBJECT = ("OBJECT_INFO", "PARTICLE_INFO", "BEVEL", "AMBIENT_OCCLUSION")
# And those that say something else for each mesh.
_OF_THE_MESH = (*_OF_THE_OBJECT, "TEX_COORD", "NEW_GEOMETRY", "ATTRIBUTE", "VERTEX_COLOR")


def lost(
    sockets: dict[str, bpy.types.NodeSocket],
    space: Space,
    material: bpy.types.Material,
    frame: int,
) -> list[str]:
    """What is lost where maps stand in for the material, a sentence each."""
    nodes = [pair for socket in sockets.values() for pair in upstream(socket, space.groups)]
    found = []
    view = {n.name for n, out in nodes if n.type in _VIEW_NODES or out in _VIEW_OUTPUTS}
    if view:
        found.append(
            f"“{material.name}” depends on the direction of view ({', '.join(sorted(view))}), "
            "which a texture cannot: it is baked as seen from straight above."
        )
    moving = {n.name for n, _ in nodes if is_animated(n)} | {
        name for name, socket in sockets.items() if is_animated(resolve(socket, space.groups))
    }
    moving |= {
        n.name
        for n, _ in nodes
        if n.type == "TEX_IMAGE" and n.image and n.image.source in ("SEQUENCE", "MOVIE")
    }
    if moving:
        found.append(
            f"“{material.name}” is animated ({', '.join(sorted(moving))}): it ages from what it "
            f"is at frame {frame}."
        )
    return found


def surprising(place: Place, space: Space, material: bpy.types.Material) -> list[str]:
    """What may surprise, whatever the object: an engine that shows no aging, and a bake of images
    that need none but for what is painted.
    """
    found = []
    if others := [each.name for each in place.beside]:
        stays = "stays" if len(others) == 1 else "stay"
        found.append(
            f"Of what the surface of “{material.name}” mixes, {place.name} ages, while "
            f"{' and '.join(others)} {stays} as made."
        )
    if (unaged := why_not_in_eevee(place)) is not None:
        found.append(unaged)
    if space.kind == "uv" and choose_space(place.principled, place.groups).kind == "texture":
        found.append(
            f"The images of “{material.name}” are baked to the UV map, because what is painted "
            "on the mesh cannot be moved or tiled with them."
        )
    return found


def lacking(material: bpy.types.Material, tiles: Tiles) -> list[str]:
    """That faces lie on tiles which the images do not have."""
    if not tiles.lacking:
        return []
    some = ", ".join(tiles.lacking[:_NAMED]) + ", ..." * (len(tiles.lacking) > _NAMED)
    return [
        f"Faces of “{material.name}” lie where its images have no tile ({some}); there "
        "they will show what is next to them."
    ]


def unwrapped_badly(
    looks: Sequence[Evaluated], material: bpy.types.Material, space: Space
) -> list[str]:
    """What a pattern of aging that is laid out by UVs will look like on these objects."""
    onset = material.tvbrdf.onset
    if onset == EVERYWHERE:
        return []
    uv_map = "" if space.kind == "uniform" else looked_up_by(space)
    if uv_map is None:
        return []
    flat, repeating = [], []
    for look in looks:
        name = uv_map or active_uv_map(look.mesh)
        if name is None or name not in look.mesh.uv_layers:
            if shows(look, material):
                called = f" “{name}”" if name else ""
                flat.append(
                    f"“{look.obj.name}” has no UV map{called}, so that it ages alike all over: "
                    "unwrap it (UV > Smart UV Project) or set Start to Everywhere at Once."
                )
            continue
        if flat_share(look, material, name) > _FLAT:
            flat.append(
                f"The UV map “{name}” of “{look.obj.name}” has no area, so that it ages alike all "
                "over: unwrap it (UV > Smart UV Project) or set Start to Everywhere at Once."
            )
        across, up = squares(look, material, name)
        if space.kind == "uniform" and onset != "attribute" and across * up > 1:
            repeating.append(
                f"The UV map “{name}” of “{look.obj.name}” reaches over {across} x {up} squares, "
                "and the pattern of aging repeats in each: give the mesh a second UV map that "
                "fits one (UV > Smart UV Project) and mark it for rendering."
            )
    return flat[:1] + repeating[:1]


def baked_badly(target: Target, coverage: Array) -> list[str]:
    """What a bake with that coverage cannot show."""
    look, tiles = target.look, target.tiles
    if look is None or not overlaps(
        look, target.material, target.uv_map, coverage, tiles.rows * tiles.columns
    ):
        return []
    return [
        f"Faces of “{look.obj.name}” overlap in the UV map “{target.uv_map}” and will share one "
        "texture: where they are to differ, unwrap them apart."
    ]


def shared(
    material: bpy.types.Material,
    obj: bpy.types.Object,
    scene: bpy.types.Scene,
    behind: Sequence[tuple[bpy.types.Node, str]],
) -> list[str]:
    """That other objects show what was baked for `obj`, where it would be something else on them;
    `behind` are the nodes of the material, each with its output.
    """
    if not any(_is_of_the_mesh(node, name) for node, name in behind):
        return []
    each_differs = any(node.type in _OF_THE_OBJECT for node, _ in behind)
    others = [each for each in showing(material, scene) if each != obj]
    differing = [each for each in others if each_differs or each.data != obj.data]
    if not differing:
        return []
    return [
        f"“{material.name}” was baked for “{obj.name}”; {len(differing)} more object(s) use it and "
        "will show the same texture on their own UVs: give them materials of their own."
    ]


def _is_of_the_mesh(node: bpy.types.Node, output: str) -> bool:
    """Whether an output says something else on each mesh, whatever its UVs."""
    if node.type in _OF_THE_MESH:
        return (node.type, output) != ("TEX_COORD", "UV")
    # Without a Vector, textures that are no images show Generated coordinates.
    vector = node.inputs.get("Vector") if node.type.startswith("TEX_") else None
    return vector is not None and node.type != "TEX_IMAGE" and not resolve(vector).is_output
