"""Waves: parts of a noise, each with a size of its own down and across.

Octaves of one shape roughen the patterns of formulas. A pattern that was learned has the waves that
its source's border shows: streaks are long waves, crumbs short ones.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

__all__ = ("Wave", "octaves", "stretch_of", "waves_from_json")

_MOST = 32
_FINEST = 1e5  # cells
_HIGHEST = 1e3


class Wave(NamedTuple):
    """Smooth noise with so many cells (down, across) to a length, of so much height (roughly, it
    goes from minus that to it).
    """

    down: float
    across: float
    height: float

    def scaled(self, length: float) -> Wave:
        """The same to another `length`, in units of the one it is told for."""
        return self._replace(down=self.down * length, across=self.across * length)


def octaves(cells: tuple[float, float], gain: float) -> Iterator[Wave]:
    """Ever finer waves of one shape, each twice as fine as the one before and `gain` as high; the
    first has so many `cells` and a height of 1.
    """
    height = 1.0
    for k in itertools.count():
        yield Wave(cells[0] * 2.0**k, cells[1] * 2.0**k, height)
        height *= gain


def stretch_of(waves: Iterable[Wave]) -> float:
    """How many times as long as wide (down over across) waves are in the mean, by their power."""
    told = [(wave.height**2, math.log(wave.across / wave.down)) for wave in waves]
    power = sum(weight for weight, _ in told)
    return math.exp(sum(weight * each for weight, each in told) / max(power, 1e-12))


def waves_from_json(value: Any) -> tuple[Wave, ...]:
    """Of a list of [down, across, height]. Raises ValueError for anything else."""
    if not isinstance(value, list) or len(value) > _MOST:
        raise ValueError("the waves of the timing are not a short list")
    waves = []
    for each in value:
        if not (isinstance(each, list) and len(each) == 3 and all(map(_is_number, each))):
            raise ValueError("a wave of the timing is not three numbers")
        wave = Wave(*map(float, each))
        cells = min(wave.down, wave.across), max(wave.down, wave.across)
        if not (cells[0] > 0 and cells[1] <= _FINEST and 0 <= wave.height <= _HIGHEST):
            raise ValueError("a wave of the timing is out of range")
        waves.append(wave)
    return tuple(waves)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
