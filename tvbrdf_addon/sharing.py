"""Says what does not travel with a file: textures that change over time, until they are frozen."""

from __future__ import annotations

from typing import Any

import bpy

from .material.nodes.record import is_live, plays
from .material.nodes.strengths import RELIEF, strength

__all__ = ("GltfHook", "left_out")


def left_out(material: bpy.types.Material) -> str | None:
    """One sentence where the file is packed, and what the material shows stays outside of it."""
    if not plays(material):
        return None
    if not bpy.data.use_autopack and all(not image.packed_file for image in bpy.data.images):
        return None
    return (
        "Textures that change over time are not packed into the file: send their folder along, or "
        "freeze the material."
    )


class GltfHook:
    """Warns in the exporter's own report, for the materials that it exports."""

    def gather_material_hook(
        self, _gltf: Any, material: bpy.types.Material, export_settings: dict[str, Any]
    ) -> None:
        if plays(material) or is_live(material):
            said = (
                f"“{material.name}” changes over time, which glTF cannot show, and is exported "
                "without textures: press Freeze at the frame to show, and export again."
            )
        elif strength(material, RELIEF) is not None:
            said = (
                f"“{material.name}” has relief, which glTF shows as a normal map alone, and is "
                "exported without: bake one (Render > Bake > Normal) to have it."
            )
        else:
            return
        export_settings["log"].warning(said, popup=True)
