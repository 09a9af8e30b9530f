"""What is made in passing, to look at something, leaves the file again.

Where something may be in use Blender looks through the whole file when it is removed, and without a
window through all that it would have told one since the file was opened: each material would take
longer the more have been aged.  Of what nothing uses it need not; and a scene, which always counts
as used, can wait for the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import bpy

from ...known import by_uid

__all__ = ("discard", "one_stage", "passing", "stage")

_COLLECTIONS = {
    "ACTION": "actions",
    "IMAGE": "images",
    "MATERIAL": "materials",
    "MESH": "meshes",
    "NODETREE": "node_groups",
    "OBJECT": "objects",
}
# Session uids of scenes that are to be used again; None where nobody asked for that.
_stages: list[int] | None = None


def discard(*made: bpy.types.ID) -> None:
    """Remove these from the file; what uses others comes before them."""
    used, with_windows = [], not bpy.app.background
    for block in made:
        name = _COLLECTIONS.get(block.id_type)
        if name is None or block.users:
            used.append(block)
        else:
            getattr(bpy.data, name).remove(block, do_unlink=False, do_ui_user=with_windows)
    if used:
        # Nor are scenes removed one by one, of which Blender (4.3) crashes without a window.
        bpy.data.batch_remove(used)


@contextmanager
def passing() -> Iterator[list[bpy.types.ID]]:
    """What is made for a look, and noted in this list, leaves the file at its end."""
    made: list[bpy.types.ID] = []
    try:
        yield made
    finally:
        scenes = [block for block in made if isinstance(block, bpy.types.Scene)]
        for scene in scenes:
            for obj in scene.collection.objects[:]:
                scene.collection.objects.unlink(obj)
            # Until then it points to what was in it, which may then be gone.
            scene.view_layers[0].update()
        others = [block for block in made if block not in scenes]
        others.sort(key=lambda block: block.id_type != "OBJECT")
        if _stages is not None:
            _stages.extend(scene.session_uid for scene in scenes)
            scenes.clear()
        discard(*others, *scenes)


@contextmanager
def one_stage() -> Iterator[None]:
    """Let all looks within this block use one scene, which leaves the file at its end."""
    global _stages
    _stages = []
    try:
        yield
    finally:
        left = [by_uid(bpy.data.scenes, uid) for uid in _stages]
        _stages = None
        discard(*(scene for scene in left if scene is not None))


def stage(
    name: str, objects: Iterable[bpy.types.Object], made: list[bpy.types.ID]
) -> bpy.types.Scene:
    """A scene with these objects only, whose time can be changed without touching the artist's; one
    of what is `made` in passing.
    """
    scene = by_uid(bpy.data.scenes, _stages.pop()) if _stages else None
    if scene is None:
        scene = bpy.data.scenes.new(name)
    made.append(scene)
    for obj in objects:
        scene.collection.objects.link(obj)
    return scene
