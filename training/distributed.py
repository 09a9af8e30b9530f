"""Training in one process or in many: whose part of a batch is whose, and what all agree on.

All processes draw the same batches, each works on its rows of them, and all take the same step down
the mean of their gradients. So a batch does not depend on how many there are, nor does a
checkpoint: it says nothing of processes, and goes on with any number of them.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from model_runtime.device import CPU, device_of
from model_runtime.errors import UsageError

__all__ = ("ALONE", "Share", "World", "exactly", "joined")


@dataclass(frozen=True)
class Share:
    """Those rows of a batch of `whole` that one process works on: every `step`-th from `first`, on
    its `device`.
    """

    whole: int
    first: int = 0
    step: int = 1
    device: torch.device = CPU

    def __call__(self, drawn: Tensor) -> Tensor:
        """The process's rows of what was drawn for all of them, [whole, ...]."""
        return drawn[self.first :: self.step].to(self.device)

    def __len__(self) -> int:
        return len(range(self.first, self.whole, self.step))

    def among(self, start: int, count: int) -> Share:
        """Its rows among the `count` from `start`, counted from there."""
        return Share(count, (self.first - start) % self.step, self.step, self.device)

    @property
    def weight(self) -> float:
        """What a mean over its rows counts, so that the mean over all processes is that over the
        batch: 1 where all have as many.
        """
        return len(self) * self.step / self.whole


class _Loss(nn.Module):
    """A loss as the module that DistributedDataParallel asks for."""

    def __init__(self, model: nn.Module, loss: Callable[[int], Tensor]) -> None:
        super().__init__()
        self.model, self.loss = model, loss

    def forward(self, step: int) -> Tensor:
        return self.loss(step)


@dataclass(frozen=True)
class World:
    """One of `size` processes, the `rank`-th from 0, and the device that it trains on."""

    rank: int = 0
    size: int = 1
    device: torch.device = CPU

    @property
    def leads(self) -> bool:
        """Whether it is the one that writes files and shows progress."""
        return self.rank == 0

    def share(self, batch: int) -> Share:
        """Its rows of `batch`; UsageError where there are not enough for all processes."""
        if batch < self.size:
            raise UsageError(
                f"A batch of {batch} cannot be divided among {self.size} processes.",
                "Start fewer, or give a larger --batch.",
            )
        return Share(batch, self.rank, self.size, self.device)

    def together(self, model: nn.Module, loss: Callable[[int], Tensor]) -> Callable[[int], Tensor]:
        """`loss`(step) on its rows, whose gradient by the weights of `model` comes out as the mean
        over all processes.
        """
        if self.size == 1:
            return loss
        devices = None if self.device == CPU else [self.device]
        return nn.parallel.DistributedDataParallel(
            _Loss(model, loss), device_ids=devices, forward_sync_buffers=False, static_graph=True
        )

    def agreed(self, value: float) -> float:
        """The `value` of the one that leads, for all."""
        if self.size == 1:
            return value
        from torch import distributed

        told = torch.tensor(value, dtype=torch.float64, device=self.device)
        distributed.broadcast(told, 0)
        return told.item()

    def mean(self, value: Tensor) -> float:
        """The mean of `value` [] over all processes."""
        if self.size == 1:
            return value.item()
        from torch import distributed

        total = value.detach().double()
        distributed.all_reduce(total)
        return total.item() / self.size

    def seconds(self) -> float:
        """A clock: of the core, so that runs beside others compare; where it waits for a GPU or for
        other processes, the one on the wall.
        """
        if self.size == 1 and self.device == CPU:
            return time.process_time()
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
        return time.monotonic()


ALONE = World()
"""One process on the CPU."""


@contextmanager
def joined(device: str) -> Iterator[World]:
    """This process among those that torchrun started, or alone, on `device`: auto, cpu, cuda or
    cuda:N. Of several each takes the GPU of its number on its machine.

    GPUs multiply matrices in TF32 meanwhile, but for what runs `exactly`. bfloat16 would leave too
    little of the numbers whose exponentials the decoder takes. Raises UsageError where there is no
    such device.
    """
    found, rank = device_of(device), 0
    size = int(os.environ.get("WORLD_SIZE", "1"))  # by torchrun, as LOCAL_RANK
    if size > 1:
        from torch import distributed

        if found.type == "cuda":
            found = device_of(f"cuda:{os.environ['LOCAL_RANK']}")
            torch.cuda.set_device(found)
        distributed.init_process_group("nccl" if found.type == "cuda" else "gloo")
        rank = distributed.get_rank()
    with _multiplying("high" if found.type == "cuda" else "highest"):
        yield World(rank, size, found)
    if size > 1:  # where it failed, the others would not come any more
        from torch import distributed

        distributed.destroy_process_group()


def exactly() -> AbstractContextManager[None]:
    """Matrices are multiplied in full precision within: what is learned from."""
    return _multiplying("highest")


@contextmanager
def _multiplying(precision: str) -> Iterator[None]:
    before = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision(precision)
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)
