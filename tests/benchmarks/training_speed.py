"""How fast an encoder trains, in as many processes as torchrun starts.

    [torchrun --standalone --nproc-per-node 2 -m | python -m] tests.benchmarks.training_speed
        [--device auto] [--batches 64 512] [--seconds 20]

Prints, for each batch, the steps a second and the milliseconds of a core that a step took the first
process, which what else the machine does hardly changes.  It needs the data (`TVBRDF_DATA`).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from model_runtime.representation import build
from training.data.location import data_folder
from training.data.nbrdf import HELD_OUT, load
from training.distributed import World, joined
from training.encoder import CONFIGS, training_loss
from training.loop import Schedule, adam, optimize

RECIPE = CONFIGS["fast"]


@dataclass(frozen=True)
class Speed:
    """Steps a second on the wall, and seconds of a core a step in this process."""

    steps: float
    core: float


def speed(world: World, batch: int, seconds: float) -> Speed:
    """Of a training with so many materials a step, over so many `seconds`, after two steps."""
    measured = load(data_folder(), "merl").without(HELD_OUT)
    model = build(RECIPE.representation).to(world.device)
    g, mine = torch.Generator().manual_seed(0), world.share(batch)

    def share_of_loss(step: int) -> Tensor:
        return training_loss(model, RECIPE, measured, g, mine)

    found = Speed(0.0, 0.0)

    def steps() -> Iterator[int]:
        nonlocal found
        yield from (0, 1)  # they allocate
        begun, core = _now(world), time.process_time()
        for count in range(1, 10**6):
            yield count
            passed = world.agreed(_now(world) - begun)
            if passed > seconds:
                found = Speed(count / passed, (time.process_time() - core) / count)
                return

    loss = world.together(model, share_of_loss)
    optimize(loss, adam(model.parameters()), Schedule(1e-3), steps(), 10**6, clip=1.0)
    return found


def _now(world: World) -> float:
    """The clock on the wall, once the device has done what it was told."""
    if world.device.type == "cuda":
        torch.cuda.synchronize(world.device)
    return time.monotonic()


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="How fast an encoder trains.")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--batches", type=int, nargs="+", default=[64, 512])
    parser.add_argument("--seconds", type=float, default=20.0)
    asked = parser.parse_args()
    with joined(asked.device) as world:
        for batch in asked.batches:
            found = speed(world, batch, asked.seconds)
            if world.leads:
                print(
                    f"{world.size} processes, {batch:,} materials a step: {found.steps:.2f} steps "
                    f"a second, {1000 * found.core:.0f} ms of a core a step",
                    flush=True,
                )


if __name__ == "__main__":
    main()
