"""One run: what is asked for, who listens, and how long its stages take."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Protocol

from .errors import Cancelled
from .output.frames import Format

__all__ = ("AgeRequest", "Reporter", "Run")


@dataclass(frozen=True)
class AgeRequest:
    """What to age, how and where to: the options of the command line (docs/design.md)."""

    input: Path
    ntm: str
    output: Path
    frames: int = 36
    size: int | None = None
    quality: Literal["draft", "balanced", "exact"] = "balanced"
    tolerance: float = 45.0
    temporal_model: str = "auto"
    onset: str = "auto"
    specular: Literal["rgb", "mono"] = "rgb"
    format: Format | None = None
    binding: Literal["auto", "live", "frames"] = "frames"
    sparse: bool = False
    seed: int = 0
    device: str = "auto"


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
    seconds: dict[str, float] = field(default_factory=dict)

    def warn(self, message: str) -> None:
        self.warnings.append(message)
        self.reporter.warning(message)

    def progress(self, stage: str, fraction: float) -> None:
        """Tell how far the whole run is, 0 to 1; raises Cancelled where the user asked for it."""
        if self.reporter.cancelled():
            raise Cancelled
        self.reporter.progress(stage, fraction)

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[stage] = round(time.perf_counter() - start, 3)
