"""Training that is killed: the system's own SIGKILL at some moment, and what is resumed from it."""

from __future__ import annotations

import json
import multiprocessing
import shutil
import time
from dataclasses import replace
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open

from model_runtime.model_files.weights import ENCODER
from model_runtime.representation import load_representation

from ...data.sequences import Sequence
from ..synthesis.sources import SourceModels

__all__ = ("killed_training",)

_LSTMS = 2  # on parameters and on latents, each also trained for a share on two ranges
_RANGES = 2
_LOOK = 0.02  # seconds


def killed_training(models: SourceModels, key: str, source: Sequence, share: float) -> SourceModels:
    """The same with a folder of its own, where it was killed after a share of the ladder's
    iterations on `source`, and has yet to resume. It writes a checkpoint after every iteration.

    One that was killed earlier, and may have resumed since, is returned as it is.
    """
    resumed = replace(models, folder=models.folder / f"killed_{share:g}", save_every=0.0)
    folder, effort = resumed.folder, models.effort.ladder
    if (folder / f"ntm_{key}.safetensors").exists():
        return resumed
    shutil.rmtree(folder, ignore_errors=True)
    total = _LSTMS * (effort.iterations + _RANGES * round(effort.iterations * effort.fold_share))
    child = multiprocessing.get_context("spawn").Process(
        target=_learn, args=(resumed, key, source, torch.get_num_threads())
    )
    child.start()
    while child.is_alive() and _iterations_done(folder) < share * total:
        time.sleep(_LOOK)
    child.kill()
    child.join()
    return resumed


def _learn(models: SourceModels, key: str, source: Sequence, threads: int) -> None:
    torch.set_num_threads(threads)
    models.ladder(key, source, *load_representation(ENCODER))


def _iterations_done(folder: Path) -> int:
    """Of all checkpoints in a folder."""
    done = 0
    for path in folder.glob("*.checkpoint.safetensors"):
        try:
            with safe_open(path, framework="pt") as stored:
                done += json.loads(stored.metadata()["record"])["step"]
        except (OSError, SafetensorError):  # replaced or removed at this moment
            continue
    return done
