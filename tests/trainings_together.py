"""What the processes do that tests/test_distributed.py starts with torchrun: small trainings.

    torchrun --nproc-per-node 2 -m tests.trainings_together FOLDER

Into FOLDER go trainings: `whole` ones, `one_first` that one process began there, one of so many
`minutes`, and the checkpoints of others that end after half the steps, `many_first`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from torch import Tensor, nn

from model_runtime.model_files.weights import ENCODER
from tests.trainings import CARD, Killed, fast_clock, small
from training import encoder, loop, ntm
from training.distributed import ALONE, World, joined

WHAT = ("fast", "ntm")
ITERATIONS = 4


def train(
    what: str,
    folder: Path,
    name: str,
    *,
    world: World = ALONE,
    resume: bool = False,
    minutes: float | None = None,
) -> None:
    """A tiny encoder (`fast`) or temporal model (`ntm`) from the sequence in FOLDER, into
    FOLDER/WHAT_NAME.
    """
    output = folder / f"{what}_{name}.safetensors"
    if what == "ntm":
        config = ntm.NTMConfig(iterations=ITERATIONS, batch=32, warm_up=3)
        ntm.train_ntm(
            sequences=(folder / "sequence",),
            encoder=ENCODER,
            output=output,
            card=CARD,
            resume=resume,
            minutes=minutes,
            config=config,
            world=world,
        )
        return
    with pytest.MonkeyPatch.context() as patch:
        sizes = {"iterations": ITERATIONS, "batch": 5, "pixels": 1, "distillation": 1}
        patch.setitem(encoder.CONFIGS, what, small(what, **sizes))
        encoder.train_encoder(config=what, output=output, resume=resume, seed=3, world=world)


@contextmanager
def ended_halfway() -> Iterator[None]:
    """All processes end after half the steps of the first part, each of which is saved."""

    def together(world: World, model: nn.Module, loss: Callable[[int], Tensor]):
        taken = joint(world, model, loss)

        def until(step: int) -> Tensor:
            if step == ITERATIONS // 2:
                raise Killed
            return taken(step)

        return until

    joint = World.together
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "time", fast_clock(61))
        patch.setattr(World, "together", together)
        with pytest.raises(Killed):
            yield


def main(folder: Path) -> None:
    with joined("auto") as world:
        for what in WHAT:
            train(what, folder, "whole", world=world)
            train(what, folder, "one_first", world=world, resume=True)
            with ended_halfway():
                train(what, folder, "many_first", world=world)
        train("ntm", folder, "minutes", world=world, minutes=1e-4)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
