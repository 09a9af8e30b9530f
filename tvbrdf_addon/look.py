"""A look at where aging starts, before anything ages: small pictures of the object in the panel."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import bpy
import bpy.utils.previews

from ..model_runtime.contract import LOOKS
from ..model_runtime.errors import Cancelled
from . import exposure, lights, masks, properties
from .errors import MaterialError
from .run import Plan, Run
from .worker import Worker

__all__ = ("Look", "draw", "unregister")

# Longer side of the textures that are looked at: the pictures have no more pixels.
_SIZE = 256
_SCALE = 7.0  # of the pictures, in heights of a button
_NOTHING_KNOWN = "Nothing is known of the surface of this material."


class _Shown(NamedTuple):
    """The pictures of the last look, and what it was asked for."""

    material_uid: int
    asked: dict[str, Any]
    pictures: bpy.utils.previews.ImagePreviewCollection


_shown: _Shown | None = None


class Look(Run):
    """A run that ages nothing: it ends in pictures of where aging would start."""

    def __init__(self, plan: Plan, worker: Worker, *, preview: bool = False) -> None:
        super().__init__(replace(plan, size=_SIZE), worker)

    def _all_steps(self) -> Iterator[None]:
        yield from self._prepare()
        asked = _asked(self._material().tvbrdf)
        with tempfile.TemporaryDirectory(prefix="tvbrdf-", ignore_cleanup_errors=True) as job:
            reading, request = self._read(Path(job))
            yield
            if self.cancel_requested:
                raise Cancelled
            if "surface" not in request:
                why = self.warnings[-1] if self.warnings else _NOTHING_KNOWN
                raise MaterialError(why, "Aging starts in a pattern of its own there.")
            pictures = Path(job) / "pictures"
            size = _SIZE if reading.uniform else max(reading.size)
            self.stage = "Starting the worker"
            yield from self._listen("look", request | {"output": str(pictures), "size": size})
            _show(_Shown(self.plan.material_uid, asked, bpy.utils.previews.new()), pictures)


def _asked(settings: Any) -> dict[str, Any]:
    """What the pictures depend on, of a material's settings."""
    said = exposure.asked(settings)
    by = {
        "mask": masks.asked(settings),
        "light": lights.told(settings, properties.card_of(settings)),
    }
    return {"ntm": settings.ntm, "seed": settings.seed, **by, **said}


def _show(shown: _Shown, folder: Path) -> None:
    global _shown
    for name in LOOKS:
        picture = shown.pictures.load(name, str(folder / name), "IMAGE")
        _ = picture.image_size[:]  # now: the file is gone soon
    unregister()
    _shown = shown


def draw(layout: bpy.types.UILayout, material: bpy.types.Material) -> None:
    layout.operator("tvbrdf.look", icon="HIDE_OFF")
    if _shown is None or _shown.material_uid != material.session_uid:
        return
    row = layout.row(align=True)
    for name in LOOKS:
        row.template_icon(_shown.pictures[name].icon_id, scale=_SCALE)
    changed = _shown.asked != _asked(material.tvbrdf)
    layout.label(
        text="The settings have changed since." if changed else _meaning(material.tvbrdf),
        icon="INFO",
    )


def _meaning(settings: Any) -> str:
    lit = lights.counts(settings, properties.card_of(settings))
    return "What is dark ages most." if lit else "What is dark starts first."


def unregister() -> None:
    global _shown
    if _shown is not None:
        bpy.utils.previews.remove(_shown.pictures)
        _shown = None
