"""Results that are dear, kept in safetensors files under the identity of what they were made
from.
"""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from model_runtime.atomic import replaced

__all__ = ("identity", "keep", "read_kept")


def identity(*ingredients: Tensor | str) -> str:
    """A digest of texts and of the values of tensors, in order."""
    digest = sha256()
    for ingredient in ingredients:
        if isinstance(ingredient, str):
            digest.update(ingredient.encode())
        else:
            digest.update(f"{tuple(ingredient.shape)}{ingredient.dtype}".encode())
            digest.update(ingredient.contiguous().numpy().tobytes())
    return digest.hexdigest()


def keep(path: Path, tensors: Mapping[str, Tensor], made_from: str) -> None:
    """Write `tensors` to `path`, whole or not at all."""
    contiguous = {name: value.contiguous() for name, value in tensors.items()}
    with replaced(path, parents=True) as beside:
        beside.write_bytes(save(contiguous, {"made_from": made_from}))


def read_kept(path: Path, made_from: str) -> dict[str, Tensor] | None:
    """What `keep` wrote to `path`; None for a file that is missing, damaged or made from anything
    else, which is to be made again.
    """
    try:
        with safe_open(path, framework="pt") as stored:
            if (stored.metadata() or {}).get("made_from") != made_from:
                return None
            return {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
    except (OSError, SafetensorError):
        return None
