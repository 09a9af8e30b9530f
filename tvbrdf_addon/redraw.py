"""Draws again what shows materials."""

from __future__ import annotations

import bpy

__all__ = ("redraw",)


def redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"NODE_EDITOR", "PROPERTIES"}:
                area.tag_redraw()
