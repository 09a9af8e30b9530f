"""A result's own report, `aged.json`, as sentences.  Imports no bpy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

from ..model_runtime.contract import AUTO, CACHE_SECONDS, CPU, REPORT, RUNGS, option
from ..model_runtime.errors import shown
from .estimate import in_bytes, in_time
from .small_json import read_json

__all__ = ("Report", "report_in")

# What no result of ours goes beyond.
_LONGEST_SIDE = 1 << 20
_MOST_FRAMES = 1 << 20
_MOST_FILES = 1 << 17
_MOST_SENTENCES = 50
_LONGEST_SENTENCE = 600

_KEPT = "Kept from an earlier run of the very same, which took that time."

_MODEL_OPTION = option("temporal_model")


@dataclass(frozen=True)
class Report:
    """What a run did: `size` (height, width), with which NTM, and what there is to say of it.

    `asked` says that the user chose the temporal model.
    """

    size: tuple[int, int]
    ntm: str
    temporal_model: str
    asked: bool
    sentences: tuple[str, ...]
    warnings: tuple[str, ...]

    def change(self, usual: str | None) -> str:
        """Which temporal model was used and why; `usual` is the one that the NTM's card names."""
        name = self.temporal_model
        if name in RUNGS:
            name = RUNGS[name].title
        if self.asked:
            return f"{name}, as you chose."
        if usual is None:
            return f"{name}, chosen automatically."
        if usual == self.temporal_model:
            return f"{name}, the simplest that fits what the model was made from."
        return f"{name}, because the material is unlike what the model was made from."


def report_in(folder: Path) -> Report | None:
    """The report of the result in `folder`; None where there is none that can be understood."""
    path = folder / REPORT
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return _read(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=8)
def _read(path: Path, _written: int, _size: int) -> Report | None:
    try:
        return _understood(read_json(path), path.parent)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, OverflowError):
        return None


def _understood(aged: dict[str, Any], folder: Path) -> Report:
    height, width = (_count(side, _LONGEST_SIDE) for side in aged["size"])
    frames = _count(aged["frames"], _MOST_FRAMES)
    stored = sum(each.lstat().st_size for each in islice(folder.iterdir(), _MOST_FILES))
    seconds = math.fsum(map(_seconds, aged["seconds"].values()))
    words = str(aged.get("command", "")).split()
    return Report(
        size=(height, width),
        ntm=shown(aged["ntm"]),
        temporal_model=shown(aged["temporal_model"]),
        asked=_MODEL_OPTION in words and words[words.index(_MODEL_OPTION) + 1] != AUTO,
        sentences=(
            *_sentences(aged["plan"]),
            f"{frames} frame{'s' * (frames > 1)} of {width} x {height} px, {in_bytes(stored)}, "
            f"in {in_time(seconds)}{_on(aged.get('device'))} "
            f"at quality {shown(aged['quality']).capitalize()}.",
            *((_KEPT,) if CACHE_SECONDS in aged else ()),
        ),
        warnings=_sentences(aged["warnings"]),
    )


def _on(device: object) -> str:
    """Worth a word where it is not the CPU, as it is in reports from before they said so."""
    return "" if device in (None, CPU) else f" on {shown(device)}"


def _count(value: object, most: int) -> int:
    if not isinstance(value, int) or not 1 <= value <= most:
        raise ValueError(f"{value!r} is not a count")
    return value


def _seconds(value: object) -> float:
    if not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise ValueError(f"{value!r} is not a time")
    return float(value)


def _sentences(value: object) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise TypeError(f"{value!r} is not a list")
    return tuple(shown(each, most=_LONGEST_SENTENCE) for each in value[:_MOST_SENTENCES])
