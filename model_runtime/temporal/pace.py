"""Statistics of when: at what times the texels of a source started, how fast they ran, and how
large, long and ragged the regions are that start together. Small enough for a model's card.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .waves import Wave, waves_from_json

__all__ = ("Timing",)

_QUANTILES = 33
_RATES = 8  # rates that stand for all, where a mean is taken


@dataclass(frozen=True)
class Timing:
    """How a source's texels are spread over time, where a texel's age is rate max(0, t - onset).

    onset: quantiles of the onset at 33 shares of the texels, 0 to 1 in equal steps; 1: never starts
    rate: quantiles of the rate, above 0 and at most 1, likewise
    scale: the distance, in units of a map's longer side, at which onsets are half as alike as one
        is to itself; None: that of the process's own pattern
    waves: what roughens and stretches their regions, with cells to that distance and heights in
        the time of a `Growth`; none: what the process itself does
    """

    onset: tuple[float, ...]
    rate: tuple[float, ...]
    scale: float | None
    waves: tuple[Wave, ...] = ()

    @classmethod
    def of(
        cls,
        onset: NDArray[np.floating] | float,
        rate: NDArray[np.floating] | float = 1.0,
        *,
        scale: float | None = None,
        waves: tuple[Wave, ...] = (),
    ) -> Timing:
        """The statistics of maps of any shape; a number stands for a map that has it everywhere.

        `Timing.of(0.0)` is a source that changes everywhere at once: the paper's behavior.
        """
        shares = np.linspace(0, 1, _QUANTILES)

        def quantiles(values: NDArray[np.floating] | float) -> tuple[float, ...]:
            return tuple(np.quantile(values, shares).round(4).tolist())

        size = None if scale is None else round(scale, 4)
        kept = tuple(Wave(*(float(f"{each:.4g}") for each in wave)) for wave in waves)
        return cls(quantiles(onset), quantiles(rate), size, kept)

    @classmethod
    def from_json(cls, value: Any) -> Timing:
        """What `json` gave. Raises ValueError for anything else, numbers out of range included."""
        if not isinstance(value, dict) or set(value) - {"waves"} != {"onset", "rate", "scale"}:
            raise ValueError("timing does not hold onset, rate and scale")
        onset, rate = (_quantiles(value[name], name) for name in ("onset", "rate"))
        if rate[0] <= 0:
            raise ValueError("a rate is not above 0")
        scale = value["scale"]
        if scale is not None and not (_is_number(scale) and 0 < scale <= 1):
            raise ValueError("the scale of the timing is not between 0 and 1")
        waves = waves_from_json(value.get("waves", []))
        return cls(onset, rate, None if scale is None else float(scale), waves)

    def json(self) -> dict[str, Any]:
        """For a card."""
        told = {"onset": list(self.onset), "rate": list(self.rate), "scale": self.scale}
        return {**told, "waves": [list(wave) for wave in self.waves]} if self.waves else told

    @property
    def at_once(self) -> bool:
        """Whether every texel starts at 0 and runs at full speed."""
        return self.onset[-1] == 0 and self.rate[0] == 1

    def mean_of_ages(self, frames: int) -> NDArray[np.float32]:
        """Weights [T, T]: how many of the source's texels have each of T ages at each of T times.

        Times and ages are evenly spaced from 0 to 1; rows add up to 1. Applied to a history, it is
        what a texel looks like whose time is unknown: the expectation over onset and rate, which
        are taken to be independent. The identity where everything changes at once.
        """
        shares = np.linspace(0, 1, _QUANTILES)
        middle = (np.arange(4 * _QUANTILES) + 0.5) / (4 * _QUANTILES)
        onset = np.interp(middle, shares, self.onset)
        rate = np.interp((np.arange(_RATES) + 0.5) / _RATES, shares, self.rate)
        time = np.linspace(0, 1, frames)[:, None, None]
        place = (np.maximum(0, time - onset[:, None]) * rate * (frames - 1)).reshape(frames, -1)
        # Seven decimals: whole ages stay whole, so that the identity is exact.
        place = place.round(7)
        lower = np.minimum(place.astype(np.int64), max(frames - 2, 0))
        weights = np.zeros((frames, frames))
        row = np.arange(frames)[:, None]
        np.add.at(weights, (row, lower), 1 - (place - lower))
        np.add.at(weights, (row, np.minimum(lower + 1, frames - 1)), place - lower)
        return (weights / place.shape[1]).astype(np.float32)


def _quantiles(value: Any, name: str) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != _QUANTILES or not all(map(_is_number, value)):
        raise ValueError(f"the timing's {name} is not {_QUANTILES} numbers")
    numbers = tuple(map(float, value))
    if numbers[0] < 0 or numbers[-1] > 1 or list(numbers) != sorted(numbers):
        raise ValueError(f"the timing's {name} does not rise from 0 to 1")
    return numbers


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
