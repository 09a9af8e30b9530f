"""TensorBoard logs of a training."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from model_runtime.errors import OutputError, reason, shown

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

__all__ = ("open_log",)


def open_log(folder: Path) -> SummaryWriter:
    """A log in `folder`; OutputError where it cannot be written."""
    from torch.utils.tensorboard import SummaryWriter  # takes seconds to import

    try:
        return SummaryWriter(folder)
    except OSError as error:
        raise OutputError(
            f"The log {shown(folder)} cannot be written: {reason(error)}.",
            "Move away what is there, or choose another output.",
        ) from error
