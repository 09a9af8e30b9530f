"""The training loop: one schedule, one clip, one checkpoint, one log for all that is trained."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from model_runtime.atomic import check_writable
from model_runtime.errors import OutputError, UsageError, reason, shown

from .checkpoint import load_checkpoint, save_checkpoint
from .distributed import ALONE, World

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter
    from tqdm import tqdm

__all__ = ("Run", "Schedule", "Training", "adam", "optimize", "remove_checkpoints", "train")

_WATCHED = 5  # iterations from one report to who watches to the next
_LOGGED = 50  # iterations from one logged loss to the next
_TRIALS = (3, 30)  # at least and at most, to measure the speed
_TRIED = 1.0  # seconds after which no more are needed
_USABLE = 0.9  # of the measured speed: the optimizer and the log take time too


@dataclass(frozen=True)
class Schedule:
    """Learning rates: a linear rise to `rate` over `warm_up` iterations, times a cosine that falls
    from 1 to `floor` at the end; a floor of 1 stays.
    """

    rate: float
    warm_up: int = 0
    floor: float = 0.01

    def at(self, step: int, iterations: int) -> float:
        """The rate at `step`, counted from 0, of `iterations`."""
        risen = self.rate * min(1.0, (step + 1) / max(1, self.warm_up))
        cosine = 0.5 * (1 + math.cos(math.pi * min(1.0, step / iterations)))
        return risen * (self.floor + (1 - self.floor) * cosine)


def adam(parameters: Iterable[Tensor]) -> torch.optim.Adam:
    """The optimizer of what is shipped; its rate is the schedule's."""
    return torch.optim.Adam(parameters, betas=(0.9, 0.99))


def optimize(
    loss: Callable[[int], Tensor],
    optimizer: torch.optim.Optimizer,
    schedule: Schedule,
    steps: Iterable[int],
    iterations: int,
    *,
    clip: float | None = None,
    after: Callable[[int, Tensor], None] = lambda step, value: None,
) -> None:
    """Take `steps` of `iterations` down `loss`(step); `after`(step, value of the loss) each.

    clip: the largest norm of the gradient, None for any
    """
    weights = [weight for group in optimizer.param_groups for weight in group["params"]]
    for step in steps:
        for group in optimizer.param_groups:
            group["lr"] = schedule.at(step, iterations)
        with torch.enable_grad():
            value = loss(step)
        optimizer.zero_grad()
        value.backward()
        if clip is not None:
            nn.utils.clip_grad_norm_(weights, clip)
        optimizer.step()
        after(step, value)


@dataclass(frozen=True)
class Run:
    """Where a training leaves its checkpoint (`base` with `name` added, which tells the parts of a
    model apart) and, unless None, its TensorBoard logs; whether it goes on from that checkpoint;
    how many minutes of a core it may take (None: as many as its iterations do); from which seed;
    how many seconds it may lose when it is killed; who hears how far each part is, by its name and
    a share from 0 to 1, and may end it by raising (None: a bar on stderr tells); and among which
    processes it is one, on which device.
    """

    base: Path
    log: Path | None = None
    resume: bool = False
    minutes: float | None = None
    seed: int = 0
    name: str = ""
    save_every: float = 60.0
    watch: Callable[[str, float], None] | None = None
    world: World = ALONE

    def part(self, name: str) -> Run:
        """The run of a part of the model."""
        return replace(self, name=f"{self.name}.{name}" if self.name else name)

    @property
    def checkpoint(self) -> Path:
        """The file it is resumed from."""
        part = f".{self.name}" if self.name else ""
        return self.base.with_suffix(f"{part}.checkpoint.safetensors")


def remove_checkpoints(run: Run, names: Iterable[str] = ("",)) -> None:
    """Remove those of the parts `names`, once the model is written."""
    for name in names:
        replace(run, name=name).checkpoint.unlink(missing_ok=True)


@dataclass(frozen=True)
class Training:
    """What is trained: `loss`(step) of a batch that is drawn with `generator`, which Adam takes
    `model` down. Of several processes each draws the batch and gives the loss of its share of it,
    so that their mean is the batch's; `model` is on the run's device.

    made_from: settings and data (JSON), which a resumed run must share
    clip: the largest norm of the gradient, None for any
    looks, look: how often the model is measured meanwhile, and how: names and numbers. The clock
        stops for it
    """

    model: nn.Module
    loss: Callable[[int], Tensor]
    schedule: Schedule
    iterations: int
    generator: torch.Generator
    made_from: Mapping[str, Any]
    clip: float | None = 1.0
    looks: int = 0
    look: Callable[[], Mapping[str, float]] | None = None


def train(training: Training, run: Run) -> dict[str, Any]:
    """Train as `run` says; returns the record: steps, `iterations`, `seconds` (those of
    `World.seconds`), and the `curve` of what `look` saw, where this process leads.

    Weights, moments, random state and step are in the checkpoint, so a run that was interrupted
    ends as an uninterrupted one, with any number of processes. All of them read it, one writes it.
    Raises what `save_checkpoint` and `load_checkpoint` do, and
    OutputError where nothing can be written, before the first step.
    """
    model, g, world = training.model, training.generator, run.world
    check_writable(run.checkpoint)
    optimizer = adam(model.parameters())
    record: dict[str, Any] = {
        "step": 0,
        "seconds": 0.0,
        "iterations": training.iterations,
        "curve": [],
        "run": {"seed": run.seed, **training.made_from},
    }
    state: dict[str, Any] = {"model": model, "optimizer": optimizer, "generator": g}
    if run.resume and run.checkpoint.exists():
        record = load_checkpoint(run.checkpoint, fresh=record, **state)
    if world.agreed(record["step"]) != record["step"]:
        raise UsageError(
            f"Not all processes see the checkpoint {shown(run.checkpoint)}.",
            "Write to a folder that all their machines share.",
        )
    log = _open_log(run.log / run.name) if run.log is not None and world.leads else None
    loss = world.together(model, training.loss)
    if run.minutes is not None and record["step"] == 0:
        record["iterations"] = _iterations_in(run.minutes, loss, optimizer, g, world)
    total, begun = record["iterations"], world.seconds() - record["seconds"]
    saved = time.monotonic()
    steps = range(record["step"], total)
    bar = _bar(steps, total) if run.watch is None and world.leads else None

    def after(step: int, value: Tensor) -> None:
        nonlocal begun, saved
        if run.watch is not None and step % _WATCHED == 0:
            run.watch(run.name, step / total)
        if step % _LOGGED == 0:
            mean = world.mean(value)
            if bar is not None:
                bar.set_postfix_str(f"{run.name} loss {mean:.5f}".strip(), refresh=False)
            if log is not None:
                log.add_scalar("loss", mean, step)
        if not world.leads:
            return
        looked, due = (at * training.looks // total for at in (step, step + 1))
        if training.look is not None and due > looked:
            paused = world.seconds()
            scores = dict(training.look())
            begun += world.seconds() - paused
            minute = round((world.seconds() - begun) / 60, 2)
            record["curve"].append({"iteration": step + 1, "minutes": minute, **scores})
            if log is not None:
                log.add_scalars("psnr", scores, step)
        if time.monotonic() - saved > run.save_every or step == total - 1:
            saved = time.monotonic()
            record.update(step=step + 1, seconds=world.seconds() - begun)
            save_checkpoint(run.checkpoint, record=record, **state)

    clip, taken = training.clip, bar or steps
    optimize(loss, optimizer, training.schedule, taken, total, clip=clip, after=after)
    return record


def _iterations_in(
    minutes: float,
    loss: Callable[[int], Tensor],
    optimizer: torch.optim.Optimizer,
    generator: torch.Generator,
    world: World,
) -> int:
    """How many fit in `minutes` here; the trials leave everything as it was."""
    drawn = generator.get_state()
    loss(0).backward()  # the first allocates
    start, trials, spent = world.seconds(), 0, 0.0
    least, most = _TRIALS
    while trials < least or (trials < most and spent < _TRIED):
        loss(0).backward()
        trials, spent = trials + 1, world.agreed(world.seconds() - start)
    optimizer.zero_grad()
    generator.set_state(drawn)
    return max(1, int(_USABLE * minutes * 60 * trials / spent))


def _bar(steps: range, total: int) -> tqdm[int]:
    """A bar on stderr that shows how far `steps` of `total` are."""
    from tqdm import tqdm  # what learns inside Blender has none

    return tqdm(steps, initial=steps.start, total=total)


def _open_log(folder: Path) -> SummaryWriter:
    """A TensorBoard log in `folder`; OutputError where it cannot be written."""
    from torch.utils.tensorboard import SummaryWriter  # takes seconds to import

    try:
        return SummaryWriter(folder)
    except OSError as error:
        raise OutputError(
            f"The log {shown(folder)} cannot be written: {reason(error)}.",
            "Move away what is there, or choose another output.",
        ) from error
