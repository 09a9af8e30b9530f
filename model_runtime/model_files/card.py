"""What a model file says of itself, checked, so that whoever shows it need not look again."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import is_plain, shown

__all__ = ("MOST_AGES", "ModelCard", "check_card", "strict_json")

MOST_AGES = 1000
"""Ages that a model tells apart at most: `frames` of its card."""

_LONGEST = {"name": 80, "title": 120, "process": 80, "representation": 80, "temporal_model": 80}
_LONGEST_TEXT = 10_000  # of any other: a description, or whose data it was learned from
_NEEDED = {"ntm": ("name", "title", "temporal_model")}
_TEXTS = ("name", "title", "description", "process", "representation", "source", "license")


@dataclass(frozen=True)
class ModelCard:
    """What a model file says of itself. `kind` is "encoder", "estimator" or "ntm"; `details` is
    the whole card; `namesake` is the bundled file, if any, whose name this other file has taken.
    """

    path: Path
    kind: str
    version: int
    name: str
    title: str
    description: str = ""
    process: str = ""
    frames: int = 0
    representation: str = ""
    domain: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    license: str = ""
    trained: Mapping[str, Any] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)
    namesake: Path | None = None

    @property
    def summary(self) -> str:
        """The description, and whose model it is where that could be mistaken."""
        whose = "" if self.namesake is None else "(yours, not the bundled model of this name)"
        return f"{self.description} {whose}".strip()


def strict_json(text: str | bytes) -> Any:
    """`json.loads`, but ValueError for NaN and for numbers that 64 bits do not hold."""

    def number(text: str) -> float:
        value = float(text)
        if not math.isfinite(value):
            raise ValueError(f"{text} is not a number")
        return value

    def whole(text: str) -> int:
        if abs(value := int(text)) >= 1 << 63:
            raise ValueError(f"{text} is too large")
        return value

    return json.loads(text, parse_int=whole, parse_float=number, parse_constant=number)


def check_card(kind: str, card: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a `ModelCard` that `card`, the JSON of a file of `kind`, has.

    Raises ValueError, saying of which field what is wrong, for what is missing or null, of another
    type, longer than anybody reads, or not plain.
    """
    for name in _NEEDED.get(kind, ("name",)):
        if not card.get(name):
            raise ValueError(f"its {name} is missing")
    for name in (*_TEXTS, "temporal_model"):
        if not isinstance(card.get(name, ""), str):
            raise ValueError(f"its {name} is not a text")
        if len(card.get(name, "")) > _LONGEST.get(name, _LONGEST_TEXT):
            raise ValueError(f"its {name} is too long")
    for name, part in card.items():
        for text in (name, *_texts(part)):
            if len(text) > _LONGEST_TEXT:
                raise ValueError(f"its {shown(name)} is endless")
            if not is_plain(text):
                raise ValueError(f"its {shown(name)} holds control characters")
    frames = card.get("frames", 0)
    if type(frames) is not int or not 0 <= frames <= MOST_AGES:
        raise ValueError(f"its frames are no number up to {MOST_AGES:,}")
    for name in ("domain", "trained"):
        if not isinstance(card.get(name, {}), dict):
            raise ValueError(f"its {name} is not an object")
    sources = card.get("sources", [])
    if not isinstance(sources, list) or not all(map(_is_source, sources)):
        raise ValueError("its sources are no list of name, license and credit")
    texts = {name: card.get(name, "") for name in _TEXTS}
    objects = {name: card.get(name, {}) for name in ("domain", "trained")}
    return {**texts, **objects, "frames": frames, "details": card}


def _is_source(value: Any) -> bool:
    return isinstance(value, dict) and all(
        isinstance(value.get(name), str) for name in ("name", "license", "credit")
    )


def _texts(value: Any) -> Iterator[str]:
    """Every text in a piece of JSON, the names of fields too."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        yield from value
        for each in value.values():
            yield from _texts(each)
    elif isinstance(value, list):
        for each in value:
            yield from _texts(each)
