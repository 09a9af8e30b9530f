"""Where else it is found: in Blender's own menus, and so by its search."""

from __future__ import annotations

import bpy

from .known import known

__all__ = ("register", "unregister")


def _in_object_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    layout = known(self.layout)
    layout.separator()
    layout.operator("tvbrdf.age_materials")


def _in_material_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    layout = known(self.layout)
    layout.separator()
    layout.operator("tvbrdf.age_material")
    layout.operator("tvbrdf.age_materials")
    layout.operator("tvbrdf.copy_settings")


_MENUS = (
    ("VIEW3D_MT_object", _in_object_menu),
    ("MATERIAL_MT_context_menu", _in_material_menu),
)


def register() -> None:
    for name, draw in _MENUS:
        getattr(bpy.types, name).append(draw)


def unregister() -> None:
    for name, draw in _MENUS:
        getattr(bpy.types, name).remove(draw)
