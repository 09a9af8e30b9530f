"""Everything that Blender is told of."""

from __future__ import annotations

import bpy

from . import (
    ageing,
    finding,
    follow,
    help,
    learn_panel,
    look,
    menus,
    mixing,
    models,
    operators,
    outlook,
    panels,
    pictures,
    preferences_panel,
    presets,
    properties,
    session,
    suiting,
)
from .headless import command

__all__ = ("CLASSES", "register", "unregister")

CLASSES = (
    *preferences_panel.CLASSES,
    *properties.CLASSES,
    *operators.CLASSES,
    *ageing.CLASSES,
    *finding.CLASSES,
    *presets.CLASSES,
    *learn_panel.CLASSES,
    *mixing.CLASSES,
    *panels.CLASSES,
    *help.CLASSES,
)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    properties.register()
    learn_panel.register()
    panels.register()
    menus.register()
    session.register()
    follow.register()
    command.register()


def unregister() -> None:
    # The worker first: it must be gone before Blender replaces the extension's files.
    session.unregister()
    panels.unregister()
    menus.unregister()
    learn_panel.unregister()
    ageing.unregister()
    look.unregister()
    follow.unregister()
    outlook.unregister()
    suiting.unregister()
    models.unregister()
    pictures.unregister()
    command.unregister()
    properties.unregister()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
