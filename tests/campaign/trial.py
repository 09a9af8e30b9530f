"""A trial: a kind and a number, a folder of its own, and programs to try."""

from __future__ import annotations

import random
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from .evidence import Answer, Ended, Evidence, Result, Tree, read_result, tree_of
from .judge import HANG_SECONDS, Normal
from .programs import Child, Watch, Worker, command
from .samples import Samples

__all__ = ("Kind", "Lane", "Trial")


@dataclass
class Lane:
    """Where one trial runs after another: honest samples, warm programs and what is normal.

    `normal` maps the name of a way to run ("worker", "command", ...) to what it takes undisturbed.
    """

    folder: Path
    samples: Samples
    normal: Mapping[str, Normal] = field(default_factory=dict)

    @cached_property
    def worker(self) -> Worker:
        return Worker(self.folder / "worker")

    @cached_property
    def other_worker(self) -> Worker:
        return Worker(self.folder / "other worker")

    @cached_property
    def reader(self) -> Child:
        return Child("-m", "tests.campaign.reader", home=self.folder / "reader")

    def limit(self, way: str) -> float:
        """The seconds after which a run is a hang."""
        known = self.normal.get(way)
        return HANG_SECONDS + (known.seconds if known else 60.0)

    def close(self) -> None:
        for child in (self.worker, self.other_worker, self.reader):
            child.end()


@dataclass(frozen=True)
class Kind:
    """A kind of trial: `attempt` does one; of all trials it has a part of the size `share`; its
    runs are compared with the undisturbed one called `way`.
    """

    name: str
    attempt: Callable[[Trial], list[Evidence]]
    share: int
    way: str = "worker"


@dataclass(frozen=True)
class Trial:
    """What an `attempt` works with: its folder, its luck, its programs."""

    number: int
    kind: Kind
    lane: Lane
    folder: Path

    @cached_property
    def rng(self) -> random.Random:
        return random.Random(f"{self.kind.name}:{self.number}")

    @cached_property
    def numpy_rng(self) -> np.random.Generator:
        return np.random.default_rng(self.rng.getrandbits(64))

    @property
    def samples(self) -> Samples:
        return self.lane.samples

    @property
    def output(self) -> Path:
        return self.folder / "out"

    def textures(self, name: str = "in") -> Path:
        """A fresh folder of honest textures."""
        return Path(shutil.copytree(self.samples.textures, self.folder / name))

    def put_earlier_result(self, output: Path | None = None) -> Result | None:
        """An earlier result of another model in the output."""
        output = output or self.output
        shutil.copytree(self.samples.earlier, output, dirs_exist_ok=True)
        return read_result(output)

    def request(self, **changes: Any) -> dict[str, Any]:
        """A short run of the honest textures, through parameters or latents."""
        return {
            "input": str(self.folder / "in"),
            "ntm": "rust",
            "output": str(self.output),
            "frames": 2,
            "quality": "draft",
            "temporal_model": self.rng.choice(("auto", "lstm_latents", "lstm_parameters")),
        } | changes

    def age(
        self, request: Mapping[str, Any], *, worker: Worker | None = None, **observed: Any
    ) -> Evidence:
        """Have the warm worker do `request`; `observed` is for `observe`."""
        limit = self.lane.limit(self.kind.way)
        worker = worker or self.lane.worker
        return self.observe(lambda: worker.ask("age", request, seconds=limit), **observed)

    def command(
        self,
        *words: str,
        module: str = "model_runtime",
        shell: str = "",
        stdout: int | None = None,
        watch: Watch | None = None,
        **observed: Any,
    ) -> Evidence:
        """Run a command; `observed` is for `observe`."""
        (self.folder / "home").mkdir(exist_ok=True)
        return self.observe(
            lambda: command(
                words,
                home=self.folder / "home",
                logs=self.lane.folder,
                seconds=self.lane.limit(self.kind.way),
                module=module,
                shell=shell,
                stdout=stdout,
                watch=watch,
            ),
            **observed,
        )

    def observe(
        self,
        program: Callable[[], Answer],
        *,
        output: Path | None = None,
        writes: bool = True,
        before: Tree | None = None,
        expected: Ended | None = None,
        alone: tuple[Mapping[str, str], ...] = (),
        beside: tuple[str, ...] = (),
    ) -> Evidence:
        """What `program` answers and does to the trial's folder, where it `writes` to `output` or
        to nothing; `before`, unless it is given, is what lies there now.
        """
        output = output or self.output
        before = tree_of(self.folder) if before is None else before
        earlier = read_result(output)
        answer = program()
        return Evidence(
            answer,
            before,
            tree_of(self.folder),
            str(output.relative_to(self.folder)) if writes else None,
            earlier,
            read_result(output),
            expected,
            alone,
            beside,
        )
