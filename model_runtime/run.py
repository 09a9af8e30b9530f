"""One run: its request, who listens, and how long its stages take."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Protocol

from .contract import STAGES, AgeRequest, Stage
from .errors import Cancelled

__all__ = ("Reporter", "Run")


class Reporter(Protocol):
    """Who hears how a run goes, and may end it."""

    def progress(self, stage: str, fraction: float) -> None: ...

    def warning(self, message: str) -> None: ...

    def cancelled(self) -> bool: ...


@dataclass
class Run:
    """One run's request, listener, clock and what it has to say at the end."""

    request: AgeRequest
    reporter: Reporter
    warnings: list[str] = field(default_factory=list)
    seconds: dict[Stage, float] = field(default_factory=dict)

    def warn(self, message: str) -> None:
        self.warnings.append(message)
        self.reporter.warning(message)

    def progress(self, stage: Stage, fraction: float) -> None:
        """Tell how far the whole run is, 0 to 1; raises Cancelled where the user asked for it."""
        if self.reporter.cancelled():
            raise Cancelled
        self.reporter.progress(STAGES[stage], fraction)

    @contextmanager
    def timed(self, stage: Stage) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[stage] = round(time.perf_counter() - start, 3)
