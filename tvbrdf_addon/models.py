"""The models that can be chosen, as Blender's list shows them."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from ..model_runtime.errors import shown
from ..model_runtime.model_files import weights
from ..model_runtime.model_files.suits import PURPOSES
from .pictures import icon_of

__all__ = ("OWN_FILE", "Item", "Models", "enum_number", "models_in", "purpose_of", "unregister")

# The item of the list that means a file of the user's own.
OWN_FILE = "file"


Item: TypeAlias = Any
"""Of the list: name, title, what it does, the number of its icon, and its own (the stubs know of
icons' names alone).
"""


class Models(NamedTuple):
    """The `cards` by name, the `items` of the list, and of each file left out a sentence why."""

    cards: dict[str, weights.ModelCard]
    items: list[Item]
    left_out: tuple[str, ...]


# Blender keeps pointers to the strings of a dynamic enum without owning them, so they live here.
_models: Models | None = None
_stamp: tuple[tuple[Path, float | None], ...] = ()


def models_in(folders: Sequence[Path]) -> Models:
    """The models in `folders`, read again only when one of these has changed."""
    global _models, _stamp
    stamp = tuple((folder, _written(folder)) for folder in folders)
    if _models is None or _stamp != stamp:
        _models, _stamp = _read(folders), stamp
    return _models


def enum_number(name: str) -> int:
    # A dynamic enum is saved as a number: it must not depend on which other models there are.
    return zlib.crc32(name.encode()) & 0x7FFFFFFF


def purpose_of(card: weights.ModelCard) -> str:
    """What a model is for: of a bundled one a few words, of another what its maker says."""
    purpose = PURPOSES.get(card.process)
    return purpose.told if purpose and card.path.parent == weights.MODELS else card.summary


def _written(folder: Path) -> float | None:
    try:
        return folder.stat().st_mtime
    except (OSError, ValueError):  # not there, or not to be looked into
        return None


def _read(folders: Sequence[Path]) -> Models:
    left_out: list[str] = []
    cards: dict[str, weights.ModelCard] = {}
    for card in weights.list_models(folders, skipped=lambda error: left_out.append(str(error))):
        if card.name == OWN_FILE:
            left_out.append(f"{shown(card.path.name)} calls itself {OWN_FILE}. Rename the model.")
        else:
            cards[card.name] = card
    items = [
        (card.name, card.title, card.summary, icon_of(card.path), enum_number(card.name))
        for card in cards.values()
    ]
    # One without a file beside it gets the picture for any model.
    icon = icon_of(weights.MODELS / OWN_FILE)
    own = (OWN_FILE, "From File…", "A model file of your own", icon, enum_number(OWN_FILE))
    return Models(cards, [*items, own], tuple(left_out))


def unregister() -> None:
    """Forget the models: the numbers of their icons end with these."""
    global _models
    _models = None
