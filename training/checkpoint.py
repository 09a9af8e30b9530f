"""Checkpoints of a training run: one safetensors file, replaced whole, from which it resumes
exactly.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import safe_open
from safetensors.torch import save
from torch import Tensor, nn

from model_runtime.atomic import replaced
from model_runtime.errors import (
    ModelFileError,
    TvbrdfError,
    UsageError,
    reason,
    shown,
)
from model_runtime.memory import ran_out_of_memory

__all__ = ("DivergedError", "load_checkpoint", "save_checkpoint")

_MOMENTS = ("exp_avg", "exp_avg_sq", "step")
_MOST_ITERATIONS = 10**8
_START_AGAIN = "Delete it and start the training without --resume."


class DivergedError(TvbrdfError):
    """A training whose weights are no numbers any more."""

    code = "diverged"

    def __init__(self) -> None:
        super().__init__(
            "The training has diverged: its weights are not finite.",
            "What was saved before is untouched; look for absurd values in what it learns from.",
        )


def save_checkpoint(
    path: Path,
    *,
    model: nn.Module,
    optimizer: torch.optim.Adam,
    generator: torch.Generator,
    record: dict[str, Any],
) -> None:
    """Write weights, Adam moments, random state and `record` (step, config, ...: JSON) to
    `path`.

    Raises DivergedError where they are not finite, OutputError where they cannot be written; an
    earlier checkpoint then stays.
    """
    tensors = {f"model.{name}": value.contiguous() for name, value in model.state_dict().items()}
    for index, state in optimizer.state_dict()["state"].items():
        for key in _MOMENTS:
            tensors[f"adam.{index}.{key}"] = state[key].contiguous()
    if _not_finite(tensors):
        raise DivergedError
    tensors["generator"] = generator.get_state()
    with replaced(path, parents=True) as beside:
        beside.write_bytes(save(tensors, metadata={"record": json.dumps(record)}))


def load_checkpoint(
    path: Path,
    *,
    model: nn.Module,
    optimizer: torch.optim.Adam,
    generator: torch.Generator,
    fresh: dict[str, Any],
) -> dict[str, Any]:
    """Restore what `save_checkpoint` wrote into the given objects and return its record.

    `fresh` is the record of a run that has not begun: it says what a record holds, and its `run`
    (JSON: seed, config, data) must equal the stored one, so that no run silently goes on with other
    settings. Raises UsageError where it does not, ModelFileError for a file that is missing,
    damaged, of another model, or holds what no training wrote.
    """
    file = shown(path)
    try:
        if not path.is_file():
            raise ValueError("it is not a file")
        with safe_open(path, framework="pt") as stored:
            record = json.loads(stored.metadata()["record"])
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
        if not isinstance(record, dict):
            raise TypeError("its record is not an object")
    except Exception as error:  # safetensors raises its own kinds for each sort of damage
        if ran_out_of_memory(error):
            raise
        raise ModelFileError(
            f"The checkpoint {file} cannot be read ({reason(error)}).", _START_AGAIN
        ) from error
    if record.get("run") != fresh["run"]:
        raise UsageError(
            f"The checkpoint {file} belongs to a run with other settings or other data.",
            "Give the same ones, or delete it and start without --resume.",
        )
    broken = _not_finite(tensors)
    if broken or not _goes_on_from(fresh, record):
        what = f"values that are not finite ({shown(broken)})" if broken else "no usable record"
        raise ModelFileError(f"The checkpoint {file} holds {what}.", _START_AGAIN)
    try:
        model.load_state_dict(
            {name[6:]: value for name, value in tensors.items() if name.startswith("model.")}
        )
        _restore(optimizer, tensors)
        generator.set_state(tensors["generator"])
    except (RuntimeError, KeyError, TypeError, ValueError) as error:
        raise ModelFileError(
            f"The checkpoint {file} belongs to another model.", _START_AGAIN
        ) from error
    return record


def _not_finite(tensors: Mapping[str, Tensor]) -> str:
    """The name of a tensor that holds NaN or infinity, if any."""
    broken = (name for name, value in tensors.items() if not bool(value.isfinite().all()))
    return next(broken, "")


def _goes_on_from(fresh: Mapping[str, Any], record: Mapping[str, Any]) -> bool:
    """Whether `record` can be one of a run that began with `fresh`."""
    if record.keys() != fresh.keys():
        return False
    if any(type(record[name]) is not type(value) for name, value in fresh.items()):
        return False
    step, seconds = record.get("step", 0), record.get("seconds", 0.0)
    iterations = record.get("iterations", _MOST_ITERATIONS)
    return 0 <= step <= iterations <= _MOST_ITERATIONS and 0 <= seconds < math.inf


def _restore(optimizer: torch.optim.Adam, tensors: Mapping[str, Tensor]) -> None:
    """Adam's moments; ValueError where they are of other shapes than the model's weights."""
    if "adam.0.step" not in tensors:
        return
    state = optimizer.state_dict()
    weights = [weight for group in optimizer.param_groups for weight in group["params"]]
    state["state"] = {
        i: {key: tensors[f"adam.{i}.{key}"] for key in _MOMENTS}
        for i in range(len(weights))
        if f"adam.{i}.step" in tensors
    }
    for i, moments in state["state"].items():
        if any(moments[key].shape != weights[i].shape for key in _MOMENTS[:2]):
            raise ValueError("moments of another shape")
    optimizer.load_state_dict(state)
