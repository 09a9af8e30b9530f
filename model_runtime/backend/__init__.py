"""What computes: PyTorch where it is installed, else what aging needs of it, over numpy.

All that computes here takes `torch` and its kind from this module, and is one code for both. Which
of the two it is says `NAME`; the environment variable `TVBRDF_BACKEND` (`torch` or `numpy`) decides
where it is set. Both make the same maps (docs/results.md); gradients, GPUs and training take
PyTorch.
"""

from __future__ import annotations

import importlib.util
import os
from typing import TYPE_CHECKING

from ..contract import BACKEND, NUMPY, TORCH

__all__ = ("NAME", "Tensor", "functional", "nn", "torch", "version")


def _chosen() -> str:
    """Of the two backends, the one to use; ImportError where it is asked for and not there."""
    wanted = os.environ.get(BACKEND) or ""
    if wanted in (TORCH, NUMPY):
        return wanted
    if wanted:
        raise ImportError(f"{BACKEND} is {wanted}, not {TORCH} or {NUMPY}")
    return TORCH if importlib.util.find_spec("torch") is not None else NUMPY


NAME = _chosen()
"""`TORCH` or `NUMPY`."""


def version() -> str:
    """What computes, and its version, for people."""
    return f"{'PyTorch' if NAME == TORCH else 'NumPy'} {importlib.import_module(NAME).__version__}"


if TYPE_CHECKING or NAME == TORCH:
    import torch
    from torch import Tensor, nn
    from torch.nn import functional
else:
    from . import on_numpy as torch
    from .on_numpy import Tensor, nn
    from .on_numpy.nn import functional
