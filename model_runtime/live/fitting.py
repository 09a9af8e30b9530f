"""As few coefficients as a tolerance asks for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..compose import AgedTexels
from ..plan import look, viewed
from .low_rank import LowRank, at_ages, fit_low_rank

__all__ = ("Fitted", "fit_live")

_CHECKED = 256  # texels at random
_WORST = 22.0  # dB by which the worst texel may miss what texels at random reach


@dataclass(frozen=True)
class Fitted:
    """A sum that is near enough, and how near: dB of "kd", "ks" and "roughness" in square-rooted
    values, of texels at random at the worst age.
    """

    sum: LowRank
    error_db: Mapping[str, float]

    @property
    def coefficients(self) -> int:
        """How many a texel has."""
        return len(self.sum.shapes)


def fit_live(
    aged: AgedTexels, tolerance: float, truth_of: Callable[[Tensor], AgedTexels]
) -> Fitted | None:
    """The sum of fewest coefficients that reaches `tolerance` dB, or what `aged` itself does where
    that is less, at every age; None where the most do not.

    It is held against texels that `truth_of` models each for itself: some at random, and those that
    it leaves farthest.
    """
    whole = fit_low_rank(aged)
    count = len(aged.initial)
    rows = torch.randint(count, (min(_CHECKED, count),), generator=torch.Generator().manual_seed(0))
    start = torch.cat((aged.initial[rows], aged.palette.entries[whole.worst]))
    entry = torch.cat((aged.palette.index[rows], whole.worst))
    truth = at_ages(truth_of(start))
    target = _look(truth)

    def errors(states: Tensor) -> Tensor:
        """[n, A]: mean square error of what is seen."""
        return (_look(states) - target).square().mean(-1)

    def reached(error: Tensor) -> float:
        """dB at the worst age, of texels at random."""
        return float(-10 * error[: len(rows)].mean(0).max().clamp_min(1e-10).log10())

    palette = replace(aged.palette, index=entry)
    asked = min(tolerance, reached(errors(at_ages(replace(aged, initial=start, palette=palette)))))
    for coefficients in range(len(whole.shapes) + 1):
        found = whole.first(coefficients)
        states = found.at_ages(start, entry)
        error = errors(states)
        if reached(error) >= asked and error.max() <= 10 ** ((_WORST - asked) / 10):
            return Fitted(found, _error_db(truth[: len(rows)], states[: len(rows)]))
    return None


def _look(states: Tensor) -> Tensor:
    """[n, A, M 3] of (kd, ks, r) [n, A, 7], at the viewing angles."""
    alpha = torch.cat((states[..., :6], states[..., 6:].square()), -1)
    return look(viewed(alpha)).flatten(1).unflatten(0, states.shape[:2])


def _error_db(truth: Tensor, states: Tensor) -> dict[str, float]:
    found = {}
    for name, channels, power in (
        ("kd", slice(0, 3), 0.5),
        ("ks", slice(3, 6), 0.5),
        ("roughness", slice(6, 7), 1.0),
    ):
        away = truth[..., channels].pow(power) - states[..., channels].pow(power)
        error = away.square().mean((0, 2)).max().clamp_min(1e-10)
        found[name] = round(float(-10 * error.log10()), 1)
    return found
