"""A saved file with three materials that can be aged, for tests of the command."""

from __future__ import annotations

from pathlib import Path

import bpy

from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged

__all__ = ("QUICK", "USUAL", "aged", "build")

QUICK = ("--frames", "1-20", "--steps", "4", "--onset", "none", "--size", "16")
USUAL = ("--ntm", "rust", *QUICK)


def build(folder: Path) -> None:
    """Saves planes of Steel, Copper and Oak in an empty file."""
    for name in ("Steel", "Copper", "Oak"):
        bpy.ops.mesh.primitive_plane_add()
        material = bpy.data.materials.new(name)
        if bpy.app.version < (5, 0):
            material.use_nodes = True
        bpy.context.object.data.materials.append(material)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "file.blend"))


def aged() -> set[str]:
    return {material.name for material in bpy.data.materials if is_aged(material)}
