"""Checkpoints of a training run: one safetensors file, replaced whole, from which it resumes
exactly.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import nn

from model_runtime.errors import ModelFileError, UsageError

__all__ = ("load_checkpoint", "save_checkpoint")


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
    """
    tensors = {f"model.{name}": value.contiguous() for name, value in model.state_dict().items()}
    for index, state in optimizer.state_dict()["state"].items():
        for key in ("exp_avg", "exp_avg_sq", "step"):
            tensors[f"adam.{index}.{key}"] = state[key].contiguous()
    tensors["generator"] = generator.get_state()
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(path.name + ".partial")
    save_file(tensors, beside, metadata={"record": json.dumps(record)})
    beside.replace(path)


def load_checkpoint(
    path: Path,
    *,
    model: nn.Module,
    optimizer: torch.optim.Adam,
    generator: torch.Generator,
    run: dict[str, Any],
) -> dict[str, Any]:
    """Restore what `save_checkpoint` wrote into the given objects and return its record.

    `run` (JSON: seed, config, data) must equal the record's own, so that no run silently goes on
    with other settings. Raises UsageError where it does not, ModelFileError for a file that is
    missing, damaged, or of another model.
    """
    try:
        with safe_open(path, framework="pt") as stored:
            record = json.loads(stored.metadata()["record"])
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
    except Exception as error:  # safetensors raises its own kinds for each sort of damage
        raise ModelFileError(
            f"The checkpoint {path} cannot be read ({error}).",
            "Delete it and start the training without --resume.",
        ) from error
    if record.get("run") != run:
        raise UsageError(
            f"The checkpoint {path} belongs to a run with other settings or other data.",
            "Give the same ones, or delete it and start without --resume.",
        )
    try:
        model.load_state_dict(
            {name[6:]: value for name, value in tensors.items() if name.startswith("model.")}
        )
    except RuntimeError as error:
        raise ModelFileError(
            f"The checkpoint {path} belongs to another model.",
            "Delete it and start the training without --resume.",
        ) from error
    state = optimizer.state_dict()
    count = len(state["param_groups"][0]["params"])
    if "adam.0.step" in tensors:
        state["state"] = {
            i: {key: tensors[f"adam.{i}.{key}"] for key in ("exp_avg", "exp_avg_sq", "step")}
            for i in range(count)
            if f"adam.{i}.step" in tensors
        }
        optimizer.load_state_dict(state)
    generator.set_state(tensors["generator"])
    return record
