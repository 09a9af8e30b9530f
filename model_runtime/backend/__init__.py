"""What computes: PyTorch, taken from here and from nowhere else in this package."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

__all__ = ("Tensor", "functional", "nn", "torch")
