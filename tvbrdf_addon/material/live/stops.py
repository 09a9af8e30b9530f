"""Which samples of a curve a Color Ramp keeps: it holds 32 stops, put where the curve bends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ("MOST", "Stops", "stops_of")

MOST = 32

Array = NDArray[np.floating]


@dataclass(frozen=True)
class Stops:
    """A curve as a ramp holds it: at `positions` [S], 0 to 1, it is `values` [S, C], and straight
    between them.
    """

    positions: tuple[float, ...]
    values: Array


def stops_of(curve: Array) -> Stops:
    """The stops of a curve [T, C] that is sampled at i / (T - 1).

    Of more than a ramp holds, those are taken one by one where what is between them is farthest
    from the curve.
    """
    span = np.ptp(curve, 0)
    values = curve / np.where(span > 0, span, 1)
    at = np.linspace(0, 1, len(curve))
    kept = [0, len(curve) - 1]
    while len(kept) < min(MOST, len(curve)):
        between = [np.interp(at, at[kept], channel[kept]) for channel in values.T]
        away = np.abs(values - np.transpose(between)).max(1)
        if not away.any():
            break
        kept = sorted((*kept, int(away.argmax())))
    return Stops(tuple(at[kept].tolist()), curve[kept])
