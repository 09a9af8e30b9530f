"""The models that can be chosen, as Blender's list shows them."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ..model_runtime import package
from ..model_runtime.errors import ModelFileError
from .plain import is_plain, plain

__all__ = ("OWN_FILE", "Models", "enum_number", "models_in")

# The item of the list that means a file of the user's own.
OWN_FILE = "file"

# What a list can show; a tooltip is a little longer.
LONGEST_NAME, LONGEST_TITLE, LONGEST_DESCRIPTION = 63, 100, 2000


class Models(NamedTuple):
    """The `cards` by name, the `items` of the list, and of each file left out a sentence why."""

    cards: dict[str, package.ModelCard]
    items: list[tuple[str, str, str, str, int]]
    left_out: tuple[str, ...]


# Blender keeps pointers to the strings of a dynamic enum without owning them, so they live here.
_models: Models | None = None
_stamp: tuple[tuple[Path, float], ...] = ()


def models_in(folders: Sequence[Path]) -> Models:
    """The models in `folders`, read again only when one of these has changed."""
    global _models, _stamp
    stamp = tuple((folder, folder.stat().st_mtime) for folder in folders if _is_there(folder))
    if _models is None or _stamp != stamp:
        _models, _stamp = _read([folder for folder, _ in stamp]), stamp
    return _models


def enum_number(name: str) -> int:
    # A dynamic enum is saved as a number: it must not depend on which other models there are.
    return zlib.crc32(name.encode()) & 0x7FFFFFFF


def _is_there(folder: Path) -> bool:
    try:
        return folder.is_dir()
    except OSError:  # in one that may not be looked into, or too long a name
        return False


def _read(folders: Sequence[Path]) -> Models:
    refused: list[ModelFileError] = []
    cards: dict[str, package.ModelCard] = {}
    left_out = []
    for card in package.list_models(folders, skipped=refused.append):
        if reason := _why_not(card):
            left_out.append(f"{plain(card.path.name)} is left out: {reason}.")
        else:
            cards.setdefault(card.name, card)
    left_out.extend(plain(error) for error in refused)
    items = [
        (card.name, card.title, card.description, "NONE", enum_number(card.name))
        for card in cards.values()
    ]
    own = (OWN_FILE, "From File…", "A model file of your own", "FILE", enum_number(OWN_FILE))
    return Models(cards, [*items, own], tuple(left_out))


def _why_not(card: package.ModelCard) -> str | None:
    """Why Blender cannot list the model: one bad text would empty the whole list."""
    for what, text, longest in (
        ("name", card.name, LONGEST_NAME),
        ("title", card.title, LONGEST_TITLE),
        ("description", card.description, LONGEST_DESCRIPTION),
    ):
        if not is_plain(text, longest=longest):
            return f"its {what} cannot be shown"
    if not card.name or not card.title:
        return "it has no name or no title"
    return f"its name is {OWN_FILE}, which means another thing" if card.name == OWN_FILE else None
