"""How strong grain and relief are, as sliders of a material: `material.tvbrdf.grain`, `.relief`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from .material.nodes.strengths import GRAIN, RELIEF, set_strengths, strength

if TYPE_CHECKING:
    from ..model_runtime.model_files.weights import ModelCard

__all__ = ("Strengths", "draw", "draw_shown")


def _show(self: Any, _context: bpy.types.Context) -> None:
    set_strengths(self.id_data, grain=self.grain, relief=self.relief)


class Strengths:
    """Of a material's settings, those that its nodes follow without another run."""

    grain: bpy.props.FloatProperty(
        name=GRAIN,
        description=(
            "How much places differ from each other where they have aged: 0 is smooth and even, 1 "
            "is as in what the model was made from. Baked frames follow when they are baked again"
        ),
        default=1.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        options=set(),
        update=_show,
    )
    relief: bpy.props.FloatProperty(
        name=RELIEF,
        description=(
            "How much aging raises and pits the surface: 0 leaves it flat, 1 is as in what the "
            "model was made from"
        ),
        default=1.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        options=set(),
        update=_show,
    )


def draw_shown(layout: bpy.types.UILayout, material: bpy.types.Material) -> None:
    """The sliders that the nodes of an aged material follow."""
    for name in (GRAIN, RELIEF):
        if strength(material, name) is not None:
            layout.prop(material.tvbrdf, name.lower(), slider=True)


def draw(layout: bpy.types.UILayout, material: bpy.types.Material, card: ModelCard | None) -> None:
    """The sliders that have something to move: in the nodes, or once the chosen model has aged it.

    `card` is the model's; None where it is not known what it has.
    """
    offered = card is None or card.version > 1
    column = layout.column(align=True)
    for name in (GRAIN, RELIEF):
        if offered or strength(material, name) is not None:
            column.prop(material.tvbrdf, name.lower(), slider=True)
