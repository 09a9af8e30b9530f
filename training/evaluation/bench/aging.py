"""The product inside an evaluation: runs of `age` that nobody watches, and their files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from model_runtime.age import AgeRequest, age
from model_runtime.modelling.aged import Effort

from ...data.sequences import Sequence

__all__ = ("age_silently", "megabytes", "texels_of")


class _Silent:
    """A reporter of runs that nobody watches: what they say is in their report."""

    def progress(self, stage: str, fraction: float) -> None:
        pass

    def warning(self, message: str) -> None:
        pass

    def cancelled(self) -> bool:
        return False


def age_silently(request: AgeRequest, effort: Effort | None = None) -> dict[str, Any]:
    """What `age` returns: the content of `aged.json`."""
    return age(request, _Silent(), effort)


def megabytes(folder: Path) -> float:
    """Of the maps in a folder."""
    return sum(path.stat().st_size for path in folder.glob("*.exr")) / 1e6


def texels_of(sequence: Sequence) -> Tensor:
    """States [T, H, W, C]."""
    return torch.from_numpy(sequence.states())
