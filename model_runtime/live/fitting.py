"""As few coefficients as a tolerance asks for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..backend import Tensor, torch
from ..brdf import principled
from ..channels import ALPHA, KD, KS, optics
from ..maps import PrincipledMaps, TorranceSparrowMaps
from ..modelling.compose import AgedTexels
from ..modelling.palette import look, viewed
from ..modelling.residues import LEAST_GRAIN, Residues
from ..states import joined
from .low_rank import MOST_COEFFICIENTS, LowRank, at_ages, fit_low_rank

__all__ = ("Fitted", "fit_live")

_CHECKED = 256  # texels at random
_WORST = 24.0  # dB by which the worst texel may miss what texels at random reach


@dataclass(frozen=True)
class Fitted:
    """A sum that is near enough, and how near: dB of "kd", "ks" and "roughness" in square-rooted
    values, of texels at random at the worst age, without residues; and of these those for which it
    leaves room.
    """

    sum: LowRank
    error_db: Mapping[str, float]
    residues: Residues | None = None

    @property
    def coefficients(self) -> int:
        """How many a texel has."""
        return len(self.sum.shapes) + (0 if self.residues is None else len(self.residues.shapes))


def fit_live(
    aged: AgedTexels,
    tolerance: float,
    truth_of: Callable[[Tensor], AgedTexels],
    authored: PrincipledMaps | None = None,
) -> Fitted | None:
    """The sum of fewest coefficients that reaches `tolerance` dB, or what `aged` itself does where
    that is less, at every age; None where the most do not, or where `aged` holds NaN. What it
    shows beyond its histories is not looked at, but takes its share of coefficients.

    It is held against texels that `truth_of` models each for itself: some at random, and those that
    it leaves farthest. Where they are to be read back as they were `authored` [H, W], they are
    looked at as that shows them.
    """
    if not aged.histories.states.isfinite().all():
        return None
    residues = aged.residues
    most = MOST_COEFFICIENTS - (0 if residues is None else min(residues.grain, LEAST_GRAIN))
    aged = replace(aged, residues=None)
    whole = fit_low_rank(aged)
    index, count = aged.palette.index, len(aged.initial)
    random = torch.randint(
        count, (min(_CHECKED, count),), generator=torch.Generator().manual_seed(0)
    )
    farthest = [(index == entry).nonzero()[0] for entry in whole.worst.unique()]
    rows = torch.cat((random, *farthest))
    some = aged.select(rows)
    sockets = None if authored is None else _texels(authored, rows)
    truth = at_ages(truth_of(some.initial))
    target = _look(truth, sockets)

    def errors(states: Tensor) -> Tensor:
        """[n, A]: mean square error of what is seen."""
        return (_look(states, sockets) - target).square().mean(-1)

    def reached(error: Tensor) -> float:
        """dB at the worst age, of texels at random."""
        return float(-10 * error[: len(random)].mean(0).max().clamp_min(1e-10).log10())

    asked = min(tolerance, reached(errors(at_ages(some))))
    for coefficients in range(min(len(whole.shapes), most) + 1):
        found = whole.first(coefficients)
        states = found.at_ages(some.initial, some.palette.index)
        error = errors(states)
        if reached(error) >= asked and error.max() <= 10 ** ((_WORST - asked) / 10):
            error_db = _error_db(truth[: len(random)], states[: len(random)])
            room = MOST_COEFFICIENTS - coefficients
            return Fitted(found, error_db, residues and residues.within(room))
    return None


def _texels(maps: PrincipledMaps, rows: Tensor) -> PrincipledMaps:
    """Only the texels `rows`, one a row."""
    places = np.divmod(rows.numpy(), maps.size[1])
    return maps.map(lambda pixels: pixels[places][:, None])


def _look(states: Tensor, sockets: PrincipledMaps | None) -> Tensor:
    """[n, A, M 3] of states [n, A, C] with roughness, at the viewing angles: as they are, or as
    texels with these `sockets` [n, 1] can show them.
    """
    size = states.shape[0], states.shape[1]
    kd, ks, r = optics(states)
    alpha = r.square()
    if sockets is not None:
        maps = TorranceSparrowMaps(kd.numpy(), ks.numpy(), alpha.numpy())
        given = sockets.map(lambda pixels: np.broadcast_to(pixels, (*size, *pixels.shape[2:])))
        shown = principled.forward(principled.read_back(maps, given))
        kd, ks, alpha = map(torch.from_numpy, (shown.kd, shown.ks, shown.alpha))
    return look(viewed(joined(kd, ks, alpha))).flatten(1).unflatten(0, size)


def _error_db(truth: Tensor, states: Tensor) -> dict[str, float]:
    found = {}
    for name, channels, power in (
        ("kd", KD, 0.5),
        ("ks", KS, 0.5),
        ("roughness", ALPHA, 1.0),
    ):
        away = truth[..., channels].pow(power) - states[..., channels].pow(power)
        error = away.square().mean((0, 2)).max().clamp_min(1e-10)
        found[name] = round(float(-10 * error.log10()), 1)
    return found
