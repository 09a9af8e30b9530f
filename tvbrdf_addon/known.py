"""What is known of Blender's data where the types of its API leave it open."""

from __future__ import annotations

from typing import Any, TypeVar

import bpy

__all__ = ("by_uid", "image_texture", "known", "scene_of", "tree_of")

_T = TypeVar("_T")


def known(pointer: _T | None) -> _T:
    """`pointer`, which is not empty here: all that Blender points with is declared as optional."""
    assert pointer is not None
    return pointer


def by_uid(collection: Any, uid: int | None) -> Any:
    """The data-block of that session uid; None where it is gone."""
    return next((block for block in collection if block.session_uid == uid), None)


def scene_of(context: bpy.types.Context) -> bpy.types.Scene:
    """The context's scene."""
    scene: object = context.scene  # a method to the stubs, whose `Context.property` hides Python's
    assert isinstance(scene, bpy.types.Scene)
    return scene


def image_texture(node: bpy.types.Node | None) -> bpy.types.ShaderNodeTexImage:
    """`node`, which is an image texture."""
    assert isinstance(node, bpy.types.ShaderNodeTexImage)
    return node


def tree_of(at: bpy.types.Node | bpy.types.NodeSocket) -> bpy.types.NodeTree:
    """The tree that a node or a socket stands in."""
    tree = at.id_data
    assert isinstance(tree, bpy.types.NodeTree)
    return tree
