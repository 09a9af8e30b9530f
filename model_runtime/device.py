"""What computes: the CPU, or a GPU where PyTorch finds one."""

from __future__ import annotations

from .backend import torch
from .contract import AUTO
from .errors import UsageError

__all__ = ("CPU", "device_of")

CPU = torch.device("cpu")


def device_of(wanted: str) -> torch.device:
    """The device called `wanted`; of `auto`, CUDA's where there is one, else the CPU.

    Apple's GPUs are not among them: the fit needs double precision. Raises UsageError where there
    is no such device.
    """
    found = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if wanted == AUTO:
        return torch.device("cuda" if found else "cpu")
    device = torch.device(wanted)
    if device.type == "cuda" and (device.index or 0) >= found:
        raise UsageError(
            f"There is no device {wanted} for this Python's torch.", "Use --device auto or cpu."
        )
    return device
