"""What a material may ask of its object and scene, told by the stand-ins that a bake uses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np

from ..nodes.animation import channels
from .evaluated import Evaluated

__all__ = ("object_like", "scene_like")

# With any of these, or without all of those, Cycles finds nothing to bake.
_HIDDEN = ("hide_render", "hide_viewport", "is_holdout", "is_shadow_catcher")
_VISIBLE = (
    *("visible_camera", "visible_diffuse", "visible_glossy", "visible_transmission"),
    *("visible_volume_scatter", "visible_shadow"),
)

Behind = Sequence[tuple[bpy.types.Node, str]]


@contextmanager
def object_like(
    look: Evaluated, materials: Sequence[bpy.types.Material], behind: Behind
) -> Iterator[bpy.types.Object]:
    """An object like the one looked at, without modifiers, with other `materials`.

    `behind` are the nodes of the material, with their outputs: where one is Object Info's Random,
    the object takes the other's name, which that is made of, as long as it is there.
    """
    with ExitStack() as stack:
        mesh = look.mesh.copy()
        stack.callback(bpy.data.meshes.remove, mesh)
        obj = look.obj.copy()
        stack.callback(bpy.data.objects.remove, obj)
        obj.modifiers.clear()
        obj.data = mesh
        for slot, material in zip(obj.material_slots, materials, strict=True):
            slot.link, slot.material = "OBJECT", material
        obj.instance_type = "NONE"
        for name in _HIDDEN:
            setattr(obj, name, False)
        for name in _VISIBLE:
            setattr(obj, name, True)
        if _is_hidden_by_keys(obj):
            obj.animation_data_clear()
            obj.matrix_basis = look.basis
        if obj.parent is not None and obj.parent.instance_type != "NONE":
            # Then only instances of it would be seen.
            obj.parent = None
            obj.matrix_world = look.obj.matrix_world
        if look.rest is not None:
            _deform(obj, look.rest)
        if any(node.type == "OBJECT_INFO" and name == "Random" for node, name in behind):
            stack.enter_context(_named(obj, look.obj))
        yield obj


def _is_hidden_by_keys(obj: bpy.types.Object) -> bool:
    data = obj.animation_data
    curves = [] if data is None else [*channels(obj), *data.drivers]
    return any(curve.data_path in (*_HIDDEN, *_VISIBLE) for curve in curves)


def _deform(obj: bpy.types.Object, rest: np.ndarray) -> None:
    """Makes the mesh one that was deformed from `rest`, for Generated coordinates."""
    mesh = obj.data
    places = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", places)
    mesh.vertices.foreach_set("co", rest.ravel())
    obj.shape_key_add(name="Rest")
    deformed = obj.shape_key_add(name="Deformed")
    deformed.data.foreach_set("co", places)
    deformed.value = 1.0
    mesh.update()


@contextmanager
def _named(obj: bpy.types.Object, like: bpy.types.Object) -> Iterator[None]:
    name = like.name
    if like.library is None:
        like.name = "tvbrdf look"
    try:
        obj.name = name
        yield
    finally:
        obj.name = "tvbrdf bake"
        if like.library is None:
            like.name = name


def scene_like(scene: bpy.types.Scene, artists: bpy.types.Scene | None, behind: Behind) -> None:
    """Gives a scene what the material's attributes of the view layer find in the artist's."""
    names = {
        node.attribute_name.strip('[]"')
        for node, _ in behind
        if node.type == "ATTRIBUTE" and node.attribute_type == "VIEW_LAYER"
    }
    if artists is None or not names:
        return
    scene.world = artists.world
    ours, theirs = scene.view_layers[0], artists.view_layers[0]
    for name in names:
        for here, there in ((scene, artists), (ours, theirs)):
            if name in there:
                here[name] = there[name]
