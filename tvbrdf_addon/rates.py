"""What a run will take, from what the last ones took on this machine.  Imports no bpy.

    seconds = start + overhead + maps + points + laid * texels
              + model * (texels where every texel is modeled, else 1)
              + fit + write * frames * texels
    bytes = stored * frames * texels

`write` and `stored` are one number for each quality, and another for live results, which store one
frame, as it were, and are fitted once; and `model` one for each quality and kind of temporal model
(through latents or not). Where nothing grows on a surface there are no `maps`, `points` and `laid`,
and no `maps` where they are kept from a run before; and no `start` where a worker waits.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ..model_runtime.contract import BALANCED, DRAFT, EXACT, LIVE, LSTM_LATENTS, Stage
from .estimate import CENTURY
from .small_json import read_json

__all__ = ("LONG_SECONDS", "Estimate", "Rates", "Work")

# What is worth a warning before the click.
LONG_SECONDS = 600.0

# How much the latest run counts against all earlier ones.
_NEWS = 0.5
# By what factor a run may differ from what was known, at most, as far as it counts.
_ODD = 3.0
# Below this many texels of all frames a run is too short to time its writing by.
_TELLING = 1_000_000


@dataclass(frozen=True)
class Work:
    """What is asked for: `texels` a frame, `frames` frames, how they are modeled, whether the
    shader is to make them (`live`), whether aging grows on a surface, whether its maps are yet to
    be made, and whether the worker is to start first (`cold`).
    """

    texels: int
    frames: int
    quality: str
    temporal_model: str
    live: bool = False
    grows: bool = False
    maps: bool = False
    cold: bool = False

    @property
    def written(self) -> int:
        """Texels that go to the disk."""
        return self.texels * (1 if self.live else self.frames)

    @property
    def writing(self) -> str:
        """The name of its writing rates."""
        return LIVE if self.live else self.quality

    @property
    def kind(self) -> str:
        """The name of its modeling rate."""
        through = "latents" if self.temporal_model == LSTM_LATENTS else "parameters"
        return f"{self.quality} {through}"

    @property
    def modeled(self) -> int:
        """What its modeling rate is multiplied by."""
        return self.texels if self.quality == EXACT else 1


@dataclass(frozen=True)
class Estimate:
    """Probable `seconds` and `bytes` on disk."""

    seconds: float
    bytes: float


# Measured (`python -m training evaluate pareto`) on two idle cores of 2020.
_FIRST: dict[str, dict[str, float]] = {
    "surface": {"maps": 2.5, "points": 1.3, "laid": 5e-7},
    "write": {DRAFT: 6e-8, BALANCED: 1.7e-7, EXACT: 1.7e-7, LIVE: 2e-7},
    "stored": {DRAFT: 12.0, BALANCED: 6.0, EXACT: 6.0, LIVE: 12.0},
    "model": {
        f"{DRAFT} parameters": 0.15,
        f"{DRAFT} latents": 0.15,
        f"{BALANCED} parameters": 0.25,
        f"{BALANCED} latents": 2.0,
        f"{EXACT} parameters": 4e-5,
        f"{EXACT} latents": 0.011,
    },
}


@dataclass(frozen=True)
class Rates:
    """What runs take on this machine; by default what they took on another."""

    overhead: float = 0.6
    fit: float = 0.3
    start: float = 3.0
    surface: Mapping[str, float] = field(default_factory=lambda: _FIRST["surface"])
    write: Mapping[str, float] = field(default_factory=lambda: _FIRST["write"])
    stored: Mapping[str, float] = field(default_factory=lambda: _FIRST["stored"])
    model: Mapping[str, float] = field(default_factory=lambda: _FIRST["model"])

    @classmethod
    def load(cls, path: Path | None) -> Rates:
        """The rates kept in `path`; the first ones where there is no such file, or a broken one."""
        try:
            kept = read_json(path) if path else {}
            tables = {name: first | kept.get(name, {}) for name, first in _FIRST.items()}
            rates = cls(**{**kept, **tables})
            for rate in (
                rates.overhead,
                rates.fit,
                rates.start,
                *(each for of in tables.values() for each in of.values()),
            ):
                if not 0 <= rate < CENTURY:
                    raise ValueError(f"{rate} is not a rate")
        except (OSError, ValueError, TypeError, AttributeError):
            return cls()
        return rates

    def save(self, path: Path) -> None:
        path.write_text(json.dumps(asdict(self), indent=1), encoding="utf-8")

    def of(self, work: Work) -> Estimate:
        """What `work` will probably take."""
        modeling = self.model[work.kind] * work.modeled + work.live * self.fit
        reading = self.overhead + work.maps * self.surface["maps"] + self._growing(work)
        reading += work.cold * self.start
        return Estimate(
            seconds=reading + modeling + self.write[work.writing] * work.written,
            bytes=self.stored[work.writing] * work.written,
        )

    def _growing(self, work: Work) -> float:
        return work.grows * (self.surface["points"] + self.surface["laid"] * work.texels)

    def after(
        self,
        aged: Mapping[str, Any],
        stored: int,
        *,
        before: float = 0.0,
        maps: float = 0.0,
        start: float = 0.0,
    ) -> Rates:
        """The rates after a run with the report `aged` (`aged.json`) that left `stored` bytes, and
        took `before` seconds until the worker had it, beside those for `maps` (0: kept) and those
        of the worker's `start` (0: it was there).
        """
        height, width = aged["size"]
        seconds: Mapping[Stage, float] = aged["seconds"]
        if not {"read", "onset", "model", "write"} <= seconds.keys():
            return self
        work = Work(
            height * width,
            aged["frames"],
            aged["quality"],
            aged["temporal_model"],
            live=aged.get("binding") == LIVE,
            grows="surface" in aged,
        )
        overhead = before + seconds["read"] + (0 if work.grows else seconds["onset"])
        model = _blend(self.model[work.kind], seconds["model"] / work.modeled)
        known = replace(
            self,
            overhead=_blend(self.overhead, overhead),
            start=_blend(self.start, start) if start else self.start,
            fit=_blend(self.fit, seconds["fit"]) if "fit" in seconds else self.fit,
            surface=self._surface_after(work, seconds["onset"], maps),
            model={**self.model, work.kind: model},
        )
        if work.written < _TELLING:
            return known
        write = _blend(self.write[work.writing], seconds["write"] / work.written)
        each = _blend(self.stored[work.writing], stored / work.written)
        return replace(
            known,
            write={**self.write, work.writing: write},
            stored={**self.stored, work.writing: each},
        )

    def _surface_after(self, work: Work, growing: float, maps: float) -> Mapping[str, float]:
        """What is there however large textures are, and what grows with them, alike."""
        surface = dict(self.surface)
        if maps:
            surface["maps"] = _blend(surface["maps"], maps)
        if (expected := self._growing(work)) > 0:
            for name in ("points", "laid"):
                surface[name] = _blend(surface[name], surface[name] * growing / expected)
        return surface


def _blend(old: float, new: float) -> float:
    """One run that took far longer than any says little: the machine was asleep, or busy."""
    if old > 0:
        new = min(max(new, old / _ODD), old * _ODD)
    return (1 - _NEWS) * old + _NEWS * new
