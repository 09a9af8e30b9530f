"""Trainings of a second: recipes cut down, a fast clock, and an end at any checkpoint."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from safetensors.torch import load_file

from training import loop
from training.checkpoint import save_checkpoint
from training.encoder import CONFIGS, EncoderConfig

CARD = {
    "name": "moss",
    "title": "Moss",
    "description": "Grows",
    "process": "rust",
    "source": "made up",
    "license": "CC0-1.0",
}
"""Of a temporal model."""


class Killed(BaseException):
    """The end of the process: nothing catches it."""


def fast_clock(step: float) -> SimpleNamespace:
    """Every look at it is `step` seconds after the last."""
    now = iter(range(10**9))
    return SimpleNamespace(monotonic=lambda: next(now) * step, process_time=time.process_time)


def kill_at(at: int, task: Callable[[], object]) -> None:
    """Call `task` with checkpoints every three steps, killed before it writes its `at`-th."""
    count = iter(range(1, 10**9))

    def save(*args, **keywords) -> None:
        if next(count) == at:
            raise Killed
        save_checkpoint(*args, **keywords)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "time", fast_clock(21))
        patch.setattr(loop, "save_checkpoint", save)
        with pytest.raises(Killed):
            task()


def small(name: str, **changes) -> EncoderConfig:
    """A recipe of a second, otherwise as `name`."""
    sizes = {"iterations": 14, "batch": 8, "targets": 16, "warm_up": 3, "looks": 0}
    sizes["distillation"] = 2
    if name == "paper":
        sizes["samples"] = 12
    return replace(CONFIGS[name], **sizes | changes)


def equal(one: Path, other: Path) -> bool:
    a, b = load_file(one), load_file(other)
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)
