"""Files of weights that nothing but a report reads: halves, and the record of their training."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors import safe_open
from safetensors.torch import save
from torch import nn

from model_runtime.atomic import replaced

__all__ = ("read_weights", "write_weights")


def write_weights(path: Path, model: nn.Module, record: Mapping[str, Any]) -> None:
    """The parameters of `model` and the `record` that `train` gave, whole or not at all."""
    weights = {name: each.detach().half() for name, each in model.named_parameters()}
    with replaced(path, parents=True) as beside:
        beside.write_bytes(save(weights, metadata={"record": json.dumps(record)}))


def read_weights(path: Path, model: nn.Module) -> dict[str, Any]:
    """Give `model` the parameters in a file of `write_weights`; returns the record."""
    with safe_open(path, framework="pt") as stored:
        model.load_state_dict({name: stored.get_tensor(name).float() for name in stored.keys()})  # noqa: SIM118
        record = json.loads(stored.metadata()["record"])
    model.eval().requires_grad_(False)
    return record
