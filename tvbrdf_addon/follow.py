"""Lets materials that age over the scene's range follow when that is changed."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from .known import scene_of
from .material.binding.retime import keyed_range, retime
from .material.nodes.age import frame_range
from .material.nodes.record import is_aged
from .material.reading.onset import showing

__all__ = ("follow", "register", "unregister")

_owner = object()


def follow() -> None:
    """Moves the keys of the scene's materials to its range, where nobody has moved them since."""
    scene = scene_of(bpy.context)
    for material in bpy.data.materials:
        settings = material.tvbrdf
        if not (is_aged(material) and settings.use_scene_range and showing(material, scene)):
            continue
        if material.library is None and keyed_range(material) == tuple(settings.keyed):
            retime(material, *frame_range(material, scene))


@persistent
def _subscribe(_file: object = None) -> None:
    # Loading a file ends all subscriptions.
    bpy.msgbus.clear_by_owner(_owner)
    for name in ("frame_start", "frame_end"):
        bpy.msgbus.subscribe_rna(
            key=(bpy.types.Scene, name),  # pyright: ignore[reportArgumentType] - all of a type
            owner=_owner,
            args=(),
            notify=follow,
        )


def register() -> None:
    bpy.app.handlers.load_post.append(_subscribe)
    _subscribe()


def unregister() -> None:
    bpy.app.handlers.load_post.remove(_subscribe)
    bpy.msgbus.clear_by_owner(_owner)
