"""Where on an object aging starts, as sliders: `material.tvbrdf.exposure`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from ..model_runtime.contract import AUTO, EXPOSURES
from .known import known

if TYPE_CHECKING:
    from ..model_runtime.model_files.weights import ModelCard

__all__ = ("CLASSES", "TVBRDF_PG_exposure", "asked", "draw", "take_over")


class TVBRDF_PG_exposure(bpy.types.PropertyGroup):
    """The weights of what may be sought or avoided, which count where the artist says so."""

    # pyright cannot follow what is named elsewhere.
    __annotations__ = {
        name: bpy.props.FloatProperty(
            name=told.title,
            description=f"{told.meaning}: 1 starts there first, -1 last"
            if name != "pattern"
            else told.meaning,
            min=0.0 if name == "pattern" else -1.0,
            max=1.0,
            precision=2,
        )
        for name, told in EXPOSURES.items()
    }


def take_over(weights: TVBRDF_PG_exposure, card: ModelCard | None) -> None:
    """Sets the sliders to what the chosen model seeks."""
    # Only now: numpy, which it needs, has no part in drawing a panel.
    from ..model_runtime.surface.exposure import Exposure

    process = card.process if card is not None else ""
    given = card.details.get("exposure") if card is not None else None
    for name, weight in Exposure.of(process, given).json().items():
        setattr(weights, name, weight)


def asked(settings: Any) -> dict[str, Any]:
    """What a request says of it, of a material's settings."""
    if settings.onset != AUTO:
        return {}
    weights = (f"{name}={getattr(settings.exposure, name):.3f}" for name in EXPOSURES)
    return {
        "exposure": ",".join(weights) if settings.use_own_exposure else None,
        "pattern_size": settings.pattern_size or None,
        "amount": settings.amount,
        "starts": settings.starts or None,
    }


def draw(layout: bpy.types.UILayout, settings: Any, *, spreads: bool) -> None:
    if not spreads:
        column = layout.column()
        column.prop(settings, "amount", slider=True)
        column.prop(settings, "use_alike")
        return
    layout.prop(settings, "use_own_exposure")
    if settings.use_own_exposure:
        column = known(layout).column(align=True)
        for name in EXPOSURES:
            column.prop(settings.exposure, name, slider=True)
    column = layout.column()
    column.prop(settings, "pattern_size")
    column.prop(settings, "seed")
    column.prop(settings, "amount", slider=True)
    column.prop(settings, "use_alike")
    row = column.row(align=True)
    row.operator("tvbrdf.start_here", text="Start at Cursor", icon="CURSOR")
    count = settings.starts.count(";") + 1 if settings.starts else 0
    if count:
        row.operator("tvbrdf.start_anywhere", text=f"Forget {count}", icon="X")


CLASSES = (TVBRDF_PG_exposure,)
