"""The points of the chart: the qualities, and every knob turned by itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from model_runtime.contract import (
    AFFINE,
    AUTO,
    BALANCED,
    CONSTANT,
    DRAFT,
    FRAMES,
    LIVE,
    LSTM_LATENTS,
    Binding,
)
from model_runtime.modelling.aged import EFFORTS, Effort

__all__ = ("LATENTS", "PANELS", "SETTINGS", "Panel", "Setting", "setting")

Panel = Literal["whole", "latents"]
PANELS: tuple[Panel, ...] = ("whole", "latents")
"""`whole`: the command as it is used, at full size. `latents`: knobs that matter only where latents
are decoded and fitted, which takes so long that it is measured on maps a quarter as wide."""

_BALANCED = EFFORTS[BALANCED]
_FINER = replace(_BALANCED, step=0.025, most=1 << 14)


@dataclass(frozen=True)
class Setting:
    """One way to age: `knob` says what differs from `balanced` ("" for the qualities themselves).

    shrink: maps are so many times smaller than those of the panel
    every: one frame of so many is asked for
    binding: what is written: frames, or a live material
    """

    name: str
    knob: str
    effort: Effort
    panel: Panel = "whole"
    rung: str = AUTO
    shrink: int = 1
    every: int = 1
    sparse: bool = False
    binding: Binding = FRAMES

    def request(self, frames: int, size: int) -> dict[str, Any]:
        """The options of `AgeRequest`, where the panel's maps are `size` wide with `frames`."""
        return {
            "frames": len(range(0, frames, self.every)),
            "size": max(1, size // self.shrink),
            "temporal_model": self.rung,
            "sparse": self.sparse,
            "binding": self.binding,
        }


def _latents(name: str, knob: str, **turned: Any) -> Setting:
    return Setting(name, knob, replace(_BALANCED, **turned), "latents", LSTM_LATENTS)


LATENTS = "latents"
"""The setting that those of the panel `latents` are turned from."""

SETTINGS = (
    Setting(DRAFT, "", EFFORTS[DRAFT]),
    Setting(BALANCED, "", _BALANCED),
    Setting("draft, live", "binding", EFFORTS[DRAFT], binding=LIVE),
    Setting("balanced, live", "binding", _BALANCED, binding=LIVE),
    Setting("palette 0.1", "palette", replace(_BALANCED, step=0.1, checked=False)),
    Setting("palette 0.025", "palette", replace(_FINER, checked=False)),
    Setting("unchecked", "palette", replace(_BALANCED, checked=False)),
    Setting("constant", "rung", _BALANCED, rung=CONSTANT),
    Setting("affine", "rung", _BALANCED, rung=AFFINE),
    Setting("every 3rd frame", "frames", _BALANCED, every=3),
    Setting("aged every 3rd frame", "frames", replace(_BALANCED, interval=3)),
    Setting("sparse", "frames", _BALANCED, sparse=True),
    Setting("size / 2", "size", _BALANCED, shrink=2),
    Setting("size / 4", "size", _BALANCED, shrink=4),
    Setting("uncompressed", "compression", replace(_BALANCED, compression="none")),
    _latents(LATENTS, ""),
    _latents("latents, palette 0.12", "palette", step=0.12, checked=False),
    _latents("latents, m = 16", "samples", samples=16),
    _latents("latents, m = 258", "samples", samples=258),
    _latents("latents, every texel", "palette", step=0.0, most=0, checked=False),
    _latents("latents, fitted", "fit", fit=True),
)


def setting(name: str) -> Setting:
    """The one of `SETTINGS` that is called `name`."""
    return next(each for each in SETTINGS if each.name == name)
