"""What a run will take, from what the last ones took on this machine.  Imports no bpy.

    seconds = overhead + model * (texels where every texel is modelled, else 1)
              + write * frames * texels
    bytes = stored * frames * texels

`write` and `stored` are one number for each quality, and another for live results, which store one
frame, as it were; and `model` one for each quality and kind of
temporal model (through latents or not).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

__all__ = ("LONG_SECONDS", "Estimate", "Rates", "Work", "in_bytes", "in_time")

# Beyond these, and where a number is none, there is nothing to tell apart.
CENTURY = 100 * 365.25 * 86400
EXABYTE = 1e18

# What is worth a warning before the click.
LONG_SECONDS = 600.0

# How much the latest run counts against all earlier ones.
_NEWS = 0.5
# Below this many texels of all frames a run is too short to time its writing by.
_TELLING = 1_000_000


@dataclass(frozen=True)
class Work:
    """What is asked for: `texels` a frame, `frames` frames, how they are modelled, and whether the
    shader is to make them (`live`).
    """

    texels: int
    frames: int
    quality: str
    temporal_model: str
    live: bool = False

    @property
    def written(self) -> int:
        """Texels that go to the disk."""
        return self.texels * (1 if self.live else self.frames)

    @property
    def writing(self) -> str:
        """The name of its writing rates."""
        return "live" if self.live else self.quality

    @property
    def kind(self) -> str:
        """The name of its modelling rate."""
        through = "latents" if self.temporal_model == "lstm_latents" else "parameters"
        return f"{self.quality} {through}"

    @property
    def modelled(self) -> int:
        """What its modelling rate is multiplied by."""
        return self.texels if self.quality == "exact" else 1


@dataclass(frozen=True)
class Estimate:
    """Probable `seconds` and `bytes` on disk."""

    seconds: float
    bytes: float


# Measured (`python -m training evaluate pareto`) on two idle cores of 2020.
_FIRST: dict[str, dict[str, float]] = {
    "write": {"draft": 6e-8, "balanced": 1.7e-7, "exact": 1.7e-7, "live": 5e-7},
    "stored": {"draft": 12.0, "balanced": 6.0, "exact": 6.0, "live": 12.0},
    "model": {
        "draft parameters": 0.15,
        "draft latents": 0.15,
        "balanced parameters": 0.25,
        "balanced latents": 2.0,
        "exact parameters": 4e-5,
        "exact latents": 0.011,
    },
}


@dataclass(frozen=True)
class Rates:
    """What runs take on this machine; by default what they took on another."""

    overhead: float = 0.6
    write: Mapping[str, float] = field(default_factory=lambda: _FIRST["write"])
    stored: Mapping[str, float] = field(default_factory=lambda: _FIRST["stored"])
    model: Mapping[str, float] = field(default_factory=lambda: _FIRST["model"])

    @classmethod
    def load(cls, path: Path | None) -> Rates:
        """The rates kept in `path`; the first ones where there is no such file, or a broken one."""
        # Here, so that this file can be loaded alone.
        from .small_json import read_json

        try:
            kept = read_json(path) if path else {}
            tables = {name: first | kept.get(name, {}) for name, first in _FIRST.items()}
            rates = cls(**{**kept, **tables})
            for rate in (rates.overhead, *(each for of in tables.values() for each in of.values())):
                if not 0 <= rate < CENTURY:
                    raise ValueError(f"{rate} is not a rate")
        except (OSError, ValueError, TypeError, AttributeError):
            return cls()
        return rates

    def save(self, path: Path) -> None:
        path.write_text(json.dumps(asdict(self), indent=1), encoding="utf-8")

    def of(self, work: Work) -> Estimate:
        """What `work` will probably take."""
        modelling = self.model[work.kind] * work.modelled
        return Estimate(
            seconds=self.overhead + modelling + self.write[work.writing] * work.written,
            bytes=self.stored[work.writing] * work.written,
        )

    def after(self, aged: Mapping[str, Any], stored: int) -> Rates:
        """The rates after a run with the report `aged` (`aged.json`) that left `stored` bytes."""
        height, width = aged["size"]
        live = aged.get("binding") == "live"
        work = Work(height * width, aged["frames"], aged["quality"], aged["temporal_model"], live)
        seconds = aged["seconds"]
        if not {"read", "onset", "model", "write"} <= seconds.keys():
            return self
        model = _blend(self.model[work.kind], seconds["model"] / work.modelled)
        known = replace(
            self,
            overhead=_blend(self.overhead, seconds["read"] + seconds["onset"]),
            model={**self.model, work.kind: model},
        )
        if work.written < _TELLING:
            return known
        spent = seconds["write"] + seconds.get("fit", 0.0)
        write = _blend(self.write[work.writing], spent / work.written)
        each = _blend(self.stored[work.writing], stored / work.written)
        return replace(
            known,
            write={**self.write, work.writing: write},
            stored={**self.stored, work.writing: each},
        )


def _blend(old: float, new: float) -> float:
    return (1 - _NEWS) * old + _NEWS * new


def in_time(seconds: float) -> str:
    """`seconds` as one says it: no finer than a guess can be."""
    if not seconds < CENTURY:
        return "over 100 years"
    for size, one, many in ((86400, "day", "days"), (3600, "hour", "hours"), (60, "min", "min")):
        if seconds >= 1.5 * size:
            count = _round(seconds / size)
            return f"{count:,.0f} {one if count == 1 else many}"
    return f"{max(1.0, _round(seconds)):.0f} s"


def in_bytes(count: float) -> str:
    """`count` bytes as one says it."""
    if not count < EXABYTE:
        return "over 1,000,000 TB"
    for size, unit in ((1e12, "TB"), (1e9, "GB")):
        if count >= size:
            tenths = f"{count / size:.1f}" if count < 10 * size else f"{_round(count / size):.0f}"
            return f"{tenths} {unit}"
    return f"{max(1.0, _round(count / 1e6)):.0f} MB"


def _round(value: float) -> float:
    """Whole below 10, to fives below 100, to tens and so on above."""
    if value < 10:
        return round(value)
    step = 5.0
    while value >= 20 * step:
        step *= 10
    return round(value / step) * step
