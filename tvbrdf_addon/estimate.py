"""An estimate as one says it: no finer than a guess can be.  Imports nothing of ours."""

from __future__ import annotations

__all__ = ("CENTURY", "in_bytes", "in_time")

# Beyond these, and where a number is none, there is nothing to tell apart.
CENTURY = 100 * 365.25 * 86400
EXABYTE = 1e18


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
