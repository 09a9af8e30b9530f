"""What the report `stability` found."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..bench.results import Result, plain
from .runs import Outcome

__all__ = ("FAILS_BELOW", "MethodResult", "StabilityReport")

FAILS_BELOW = 25.0
"""dB"""


@dataclass(frozen=True)
class MethodResult(Result):
    """One method under one stress: its outcome at each severity, from harmless to absurd.

    product: whether it is the one that can notice
    """

    outcomes: Mapping[float, Outcome]
    product: bool = False

    @property
    def fails_at(self) -> float | None:
        """The first severity at which nothing useful comes out; None where it always does."""
        return next((x for x, found in self.outcomes.items() if _failure(found)), None)

    @property
    def holds_to(self) -> float | None:
        """The last severity before it fails; None where it fails from the first."""
        return list(self.outcomes)[self.steps - 1] if self.steps else None

    @property
    def steps(self) -> int:
        """How many severities it bears before it fails."""
        failing = self.fails_at
        return len(self.outcomes) if failing is None else list(self.outcomes).index(failing)

    @property
    def noticed(self) -> bool | None:
        """Whether the product said something at every severity at which it fails; None for other
        methods, and where it never fails.
        """
        failing = [found for found in self.outcomes.values() if _failure(found)]
        if not self.product or not failing:
            return None
        return all(found.said for found in failing)

    @property
    def noticed_from(self) -> float | None:
        """The first severity at which the product said something."""
        return next((x for x, found in self.outcomes.items() if found.said), None)

    def json(self) -> dict[str, Any]:
        """`curve`: [severity, PSNR or null] each; `failure`: why it fails where it first does."""
        failing = self.fails_at
        row: dict[str, Any] = {
            "fails_at": failing,
            "noticed": self.noticed,
            "curve": [[x, plain(found.psnr, 2)] for x, found in self.outcomes.items()],
            "failure": None if failing is None else _failure(self.outcomes[failing]),
        }
        if self.product:
            row["noticed_from"] = self.noticed_from
            row["said"] = {f"{x:g}": list(o.said) for x, o in self.outcomes.items() if o.said}
        return row


def _failure(found: Outcome) -> str | None:
    """What is wrong, in a word or two; None where nothing is."""
    if math.isnan(found.psnr):
        return "refused" if found.said else "nothing finite"
    if found.psnr < FAILS_BELOW:
        return f"below {FAILS_BELOW:g} dB"
    return None if found.in_gamut else "out of gamut"


@dataclass(frozen=True)
class StabilityReport(Result):
    """Every stress by name, with its methods by name."""

    stresses: Mapping[str, Mapping[str, MethodResult]]
    settings: Mapping[str, Any]
    seconds: float

    def behind(self, stress: str) -> dict[str, float | None]:
        """The rivals that bear more of a stress than ours, and up to where."""
        methods = self.stresses[stress]
        if "ours" not in methods:
            return {}
        ours = methods["ours"].steps
        return {n: found.holds_to for n, found in methods.items() if found.steps > ours}

    def json(self) -> dict[str, Any]:
        """The content of `stability.json`."""
        stresses = {name: {"methods": methods} for name, methods in self.stresses.items()}
        settings = {"settings": self.settings, "seconds": round(self.seconds, 1)}
        return plain({"stresses": stresses, **settings})
