"""A result's own report, `aged.json`, as sentences.  Imports no bpy."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from .estimate import in_bytes, in_time

__all__ = ("Report", "report_in")

_MODEL_OPTION = "--temporal-model"
_MODELS = {
    "constant": "Constant",
    "affine": "Affine",
    "lstm_parameters": "LSTM on Parameters",
    "lstm_latents": "LSTM on Latents",
}


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
        name = _MODELS.get(self.temporal_model, self.temporal_model)
        if self.asked:
            return f"{name}, as you chose."
        if usual is None:
            return f"{name}, chosen automatically."
        if usual == self.temporal_model:
            return f"{name}, the simplest that fits what the model was made from."
        return f"{name}, because the material is unlike what the model was made from."


def report_in(folder: Path) -> Report | None:
    """The report of the result in `folder`; None where there is none that can be understood."""
    path = folder / "aged.json"
    try:
        return _read(path, path.stat().st_mtime_ns)
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return None


@lru_cache(maxsize=8)
def _read(path: Path, _written: int) -> Report:
    aged = json.loads(path.read_text(encoding="utf-8"))
    height, width = map(int, aged["size"])
    stored = sum(each.stat().st_size for each in path.parent.iterdir())
    seconds = sum(map(float, aged["seconds"].values()))
    frames = int(aged["frames"])
    words = shlex.split(str(aged.get("command", "")))
    return Report(
        size=(height, width),
        ntm=str(aged["ntm"]),
        temporal_model=str(aged["temporal_model"]),
        asked=_MODEL_OPTION in words and words[words.index(_MODEL_OPTION) + 1] != "auto",
        sentences=(
            *map(str, aged["plan"]),
            f"{frames} frame{'s' * (frames > 1)} of {width} x {height} px, {in_bytes(stored)}, "
            f"in {in_time(seconds)} at quality {str(aged['quality']).capitalize()}.",
        ),
        warnings=tuple(map(str, aged["warnings"])),
    )
