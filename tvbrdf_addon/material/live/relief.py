"""Heights as a shader shows them: a change of normals, or of a displacement.

These groups are shared by all aged materials of a file.
"""

from __future__ import annotations

import bpy

from ..nodes.strengths import RELIEF
from .formula import Canvas, Number, Triple, greater, where3
from .mapping import shared_group

__all__ = ("displaced_group", "relief_group")

_FILTER, _FILTER_PIXELS = "Filter Width", 1.0
"""Between which heights are compared: what Blender 4.2 to 4.4 do, which cannot be told."""


def relief_group() -> bpy.types.NodeTree:
    """A normal that shows heights, of which one is Distance high; as it is given where they are 0.

    A Bump node alone would change the last bit even of what is flat.
    """
    return shared_group("Relief on Normal", (*_HEIGHTS, "Normal"), ("Normal",), _bumped)


def displaced_group() -> bpy.types.NodeTree:
    """A displacement, and heights along the normal on top, of which one is Distance high."""
    names = ("Displacement",)
    return shared_group("Relief on Displacement", (*_HEIGHTS, *names), names, _displaced)


_HEIGHTS = ("Height", "Distance", RELIEF)


def _bumped(canvas: Canvas) -> dict[str, Number | Triple]:
    with canvas.stage("Bump"):
        height, normal = canvas.number("Height"), canvas.triple("Normal")
        bump = canvas.add(
            "ShaderNodeBump",
            by_name={
                "Height": height,
                "Distance": canvas.number("Distance"),
                "Strength": canvas.number(RELIEF),
                "Normal": normal,
            },
        )
        if _FILTER in bump.inputs:
            bump.inputs[_FILTER].default_value = _FILTER_PIXELS
    with canvas.stage("As given where it is flat"):
        raised = greater(canvas.math("ABSOLUTE", height), 0.0)
        return {"Normal": where3(raised, Triple(canvas, bump.outputs["Normal"]), normal)}


def _displaced(canvas: Canvas) -> dict[str, Number | Triple]:
    with canvas.stage("Displacement + height · distance"):
        by_name = {
            "Height": canvas.number("Height"),
            "Midlevel": 0.0,
            "Scale": canvas.number("Distance") * canvas.number(RELIEF),
        }
        ours = canvas.add("ShaderNodeDisplacement", by_name=by_name, space="WORLD")
        given = canvas.triple("Displacement")
        return {"Displacement": given + Triple(canvas, ours.outputs["Displacement"])}
