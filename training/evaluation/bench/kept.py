"""Results that are dear, kept in files under the identity of what they were made from."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from model_runtime.atomic import replaced
from model_runtime.model_files.weights import hash_tensors

__all__ = ("code", "identity", "kept", "kept_json")

_PACKAGES = Path(__file__).resolve().parents[3]
_JUDGES = "evaluation"  # of training: what it finds has identities of its own


def identity(*ingredients: Tensor | str) -> str:
    """A digest of texts and of the values of tensors, in order."""
    texts = (each if isinstance(each, str) else hash_tensors({"": each}) for each in ingredients)
    return sha256("\n".join(texts).encode()).hexdigest()


@cache
def code() -> str:
    """A digest of the program that learns and ages: its sources, but for reports."""
    files = (
        path
        for package in ("model_runtime", "training")
        for path in sorted((_PACKAGES / package).rglob("*.py"))
        if _JUDGES not in path.relative_to(_PACKAGES).parts
    )
    return identity(*(f"{path.name} {path.read_text(encoding='utf-8')}" for path in files))


def kept(path: Path, made_from: str, make: Callable[[], Mapping[str, Tensor]]) -> dict[str, Tensor]:
    """The tensors at `path`, by name. Where they are missing, damaged or made from anything else,
    they are those that `make` gives, and are written there whole or not at all.
    """
    try:
        with safe_open(path, framework="pt") as stored:
            if (stored.metadata() or {}).get("made_from") == made_from:
                return {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
    except (OSError, SafetensorError):
        pass
    tensors = {name: value.contiguous() for name, value in make().items()}
    with replaced(path, parents=True) as beside:
        beside.write_bytes(save(tensors, {"made_from": made_from}))
    return tensors


def kept_json(path: Path, made_from: str, make: Callable[[], Any]) -> Any:
    """The JSON value at `path`, as `kept` does it."""
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        if stored["made_from"] == made_from:
            return stored["value"]
    except (OSError, ValueError, KeyError, TypeError):
        pass
    value = make()
    with replaced(path, parents=True) as beside:
        beside.write_text(json.dumps({"made_from": made_from, "value": value}), encoding="utf-8")
    return value
