"""The pictures by which models are picked: `NAME.jpg` beside a model's file, or one for any."""

from __future__ import annotations

from pathlib import Path

import bpy
import bpy.utils.previews

from ..model_runtime.model_files import weights

__all__ = ("icon_of", "picture_of", "unregister")

_ANY = weights.MODELS / "any.jpg"

_pictures: bpy.utils.previews.ImagePreviewCollection | None = None


def picture_of(model: Path) -> Path:
    """The picture that shows what the model in that file does."""
    picture = model.with_suffix(".jpg")
    return picture if picture.is_file() else _ANY


def icon_of(model: Path) -> int:
    """The number of the icon with its picture; 0 where Blender has no window."""
    global _pictures
    if _pictures is None:
        _pictures = bpy.utils.previews.new()
    path = str(picture_of(model))
    # Under a name of its own each time it is written: what was loaded once stays as it was.
    name = f"{path} {Path(path).stat().st_mtime_ns}"
    if name not in _pictures:
        # At once: nobody draws again when a picture has come.
        _ = _pictures.load(name, path, "IMAGE").icon_size[:]
    return _pictures[name].icon_id


def unregister() -> None:
    global _pictures
    if _pictures is not None:
        bpy.utils.previews.remove(_pictures)
        _pictures = None
