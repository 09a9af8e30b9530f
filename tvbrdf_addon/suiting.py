"""Which models suit a material: the order they are listed in, and which is chosen at first."""

from __future__ import annotations

from typing import Any

import bpy

from ..model_runtime.model_files.suits import Suited, Surface, ordered
from . import preferences
from .material.nodes.record import is_aged
from .models import Item, Models, models_in

__all__ = ("doubt", "look_at", "models_for", "unregister")

# What was seen of materials, and how the models suit it.  Aging replaces what could be seen.
_surfaces: dict[int, Surface] = {}
_orders: dict[int, tuple[Surface, Models, list[Suited]]] = {}


def look_at(material: bpy.types.Material) -> bool:
    """Looks at `material` and chooses the model that suits it best, where nobody has chosen one;
    whether that changed what is to be shown.
    """
    if is_aged(material) or material.library is not None:
        return False
    # Only now: numpy, which it needs, has no part in drawing a panel.
    from .material.reading.appearance import surface_of

    surface, uid = surface_of(material), material.session_uid
    changed = surface != _surfaces.get(uid)
    _surfaces[uid] = surface
    settings = material.tvbrdf
    if _is_automatic(settings) and (suited := _suited(material)):
        changed = changed or settings.ntm != suited[0].name
        settings.ntm = suited[0].name
        settings.suggested = suited[0].name  # only now, as a choice forgets it
    return changed


def _is_automatic(settings: Any) -> bool:
    """Whether nobody has chosen the model."""
    return settings.ntm == settings.suggested or not settings.is_property_set("ntm")


def models_for(material: bpy.types.ID | None) -> list[Item]:
    """The items of the list of models, what suits `material` best first, as far as is known."""
    models = models_in(preferences.model_folders())
    suited = _suited(material) if material is not None else []
    if not suited:
        return models.items
    ranks = {each.name: rank for rank, each in enumerate(suited)}
    return sorted(models.items, key=lambda item: ranks.get(item[0], len(ranks)))


def doubt(material: bpy.types.Material) -> str:
    """A sentence where the chosen model is not made for `material`; else nothing."""
    chosen = material.tvbrdf.ntm
    return next((each.doubt for each in _suited(material) if each.name == chosen), "")


def _suited(material: bpy.types.ID) -> list[Suited]:
    surface = _surfaces.get(material.session_uid)
    if surface is None:
        return []
    models = models_in(preferences.model_folders())
    known = _orders.get(material.session_uid)
    if known is None or known[0] != surface or known[1] is not models:
        known = (surface, models, ordered(models.cards.values(), surface))
        _orders[material.session_uid] = known
    return known[2]


def unregister() -> None:
    _surfaces.clear()
    _orders.clear()
