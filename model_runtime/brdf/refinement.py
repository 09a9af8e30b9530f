"""Parameters of measured BRDFs, whatever they mean, brought closer to what was measured."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ..backend import Tensor, torch
from ..channels import ALPHA_MIN, KD, KS, WIDTH, optics
from ..contract import Specular
from ..states import joined
from . import torrance_sparrow
from .fit import fit_angles, fit_torrance_sparrow, relative_error
from .views import Views, other_views, psnr_of, views

__all__ = (
    "DOUBTFUL",
    "LEAST_ROOT",
    "STEPS",
    "WELL_HELD",
    "Measurements",
    "SeenFit",
    "fit_seen",
    "nearest",
    "rooted",
    "unrooted",
)

WELL_HELD = 45.0
"""dB from which nothing is refined: hardly anybody sees what is still missing."""

DOUBTFUL = 30.0
"""dB below which the user is told what is missing."""

STEPS = 20
"""By which parameters are brought closer."""

_DAMPING, _EASED, _STIFFENED = 0.1, 0.3, 4.0  # of a step, at first and after one that helped or not
_LEAST_STIFF = 1e-9
_NUDGE = 1e-3  # of a parameter, for its slope
_TOGETHER = 8  # materials: what they need stays small
_RELATIVE = 0.002  # of the loss: what no view shows
_DARK = 0.01  # 1/sr; a near-black diffuse

LEAST_ROOT = 0.02
"""Least root of a reflectance at first, that descends away from 0."""

Evaluate = Callable[[Tensor, Tensor], Tensor]
"""(parameters [N, D], angles [M, 3]) -> f [N, M, 3]"""


@dataclass(frozen=True)
class Measurements:
    """What is read of N BRDFs: values at `views()`, and those at `other_views()`, that are held
    back and only tell how much is missing. NaN and infinity mark what was not measured.
    """

    read: Tensor
    held_back: Tensor

    @classmethod
    def of(cls, evaluate: Callable[[Tensor], Tensor]) -> Measurements:
        """`evaluate`(angles [M, 3]) -> f [N, M, 3]"""
        return cls(*(evaluate(each.angles) for each in (views(), other_views())))

    def __getitem__(self, rows: Tensor) -> Measurements:
        return Measurements(self.read[rows], self.held_back[rows])

    def psnr(self, f: Tensor) -> Tensor:
        """How near values `f` [N, M, 3] at `other_views()` look, in dB [N]."""
        return psnr_of(*_shown(other_views(), self.held_back, f))

    def nearest(
        self, start: Tensor, evaluate: Evaluate, steps: int = STEPS, free: Tensor | None = None
    ) -> Tensor:
        """Parameters [N, D] that look nearer than `start` at `views()`; `start`, where there are
        none. `free` [N, D] is 0 of those that stay as they start.
        """
        return nearest(self.read, start, evaluate, steps, free)

    def missed(self, parameters: Tensor, evaluate: Evaluate) -> Tensor:
        """How much `parameters` [N, D] miss of what is seen at `views()`: [N], what `nearest`
        makes less.
        """
        return _missing(self.read, evaluate(parameters, views().angles)).square().sum(1)


def nearest(
    read: Tensor,
    start: Tensor,
    evaluate: Evaluate,
    steps: int = STEPS,
    free: Tensor | None = None,
) -> Tensor:
    """`Measurements.nearest` of values `read` [N, M, 3] at `views()`."""
    free = torch.ones_like(start) if free is None else free
    parts = zip(read.split(_TOGETHER), start.split(_TOGETHER), free.split(_TOGETHER), strict=True)
    return torch.cat([_nearest(*some, evaluate, steps) for some in parts])


def _nearest(truth: Tensor, x: Tensor, free: Tensor, evaluate: Evaluate, steps: int) -> Tensor:
    """By the method of Levenberg and Marquardt, each of N materials for itself."""
    angles = views().angles
    left = _missing(truth, evaluate(x, angles))
    damping = torch.full_like(x[:, 0], _DAMPING)
    for _ in range(steps):
        slopes = (_slopes(truth, x, left, evaluate) * free[..., None]).double()
        square = slopes @ slopes.mT
        stiff = damping[:, None, None] * torch.eye(x.shape[1]) * (square + _LEAST_STIFF)
        step = torch.linalg.solve(square + stiff, slopes @ left.double()[..., None])
        tried = x - step[..., 0].float()
        trial = _missing(truth, evaluate(tried, angles))
        nearer = trial.square().sum(1) < left.square().sum(1)
        x = torch.where(nearer[:, None], tried, x)
        left = torch.where(nearer[:, None], trial, left)
        damping = torch.where(nearer, damping * _EASED, damping * _STIFFENED)
    return x


def _slopes(truth: Tensor, x: Tensor, left: Tensor, evaluate: Evaluate) -> Tensor:
    """How what is missing, `left` [N, R], changes with each of the parameters `x` [N, D]:
    [N, D, R], by differences.
    """
    count, width = x.shape
    moved = (x[:, None] + _NUDGE * torch.eye(width)).flatten(0, 1)
    truth = truth[:, None].expand(-1, width, -1, -1).flatten(0, 1)
    beside = _missing(truth, evaluate(moved, views().angles))
    return (beside.unflatten(0, (count, width)) - left[:, None]) / _NUDGE


def _shown(seen_from: Views, truth: Tensor, estimate: Tensor) -> tuple[Tensor, Tensor]:
    """Pixels [N, V, L, 3] of both, without what was not measured."""
    known = truth.isfinite().all(-1, keepdim=True)
    return tuple(seen_from.seen(torch.where(known, f, 0)) for f in (truth, estimate))  # pyright: ignore[reportReturnType]


def _missing(truth: Tensor, estimate: Tensor) -> Tensor:
    """What N materials lack of what is to be seen, pixel by pixel, and a little of what no view
    shows: [N, R], whose squares add up to the loss.
    """
    shown, guessed = (each.flatten(1) for each in _shown(views(), truth, estimate))
    known = truth.isfinite().all(-1, keepdim=True)
    apart = torch.log1p(estimate / _DARK) - torch.log1p(truth.clamp_min(0) / _DARK)
    apart = torch.where(known, apart, 0).flatten(1)
    seen = (guessed - shown) / math.sqrt(shown.shape[1])
    return torch.cat((seen, apart * math.sqrt(_RELATIVE / apart.shape[1])), 1)


@dataclass(frozen=True)
class SeenFit:
    """Torrance-Sparrow states [N, C] of N measured BRDFs; [N] each, the relative RMS `error` over
    directions, and how near they look in `db`.
    """

    states: Tensor
    error: Tensor
    db: Tensor


def fit_seen(evaluate: Callable[[Tensor], Tensor], specular: Specular = "rgb") -> SeenFit:
    """The fit of N BRDFs `evaluate`(angles [M, 3]) -> f [N, M, 3] by least squares of the relative
    error; where that misses what is seen, one that looks nearer.
    """
    measured, f = Measurements.of(evaluate), evaluate(fit_angles())
    fit = fit_torrance_sparrow(f, specular=specular)
    states, error, angles = fit.parameters(), fit.error, other_views().angles
    db = measured.psnr(torrance_sparrow.evaluate(*optics(states), angles))
    off = (db < WELL_HELD).nonzero()[:, 0]
    if len(off):
        some = measured[off]
        found = some.nearest(rooted(states[off]), lambda x, a: _values(x, a, specular))
        refined = unrooted(found, specular)
        nearer = some.psnr(torrance_sparrow.evaluate(*optics(refined), angles))
        better = nearer > db[off]
        rows = off[better]
        states, error, db = states.clone(), error.clone(), db.clone()
        states[rows], db[rows] = refined[better], nearer[better]
        shows = torrance_sparrow.evaluate(*optics(refined[better].double()), fit_angles().double())
        error[rows] = relative_error(f[rows], shows)
    return SeenFit(states, error, db)


def rooted(states: Tensor) -> Tensor:
    """Coordinates [N, C] without bounds: roots of reflectances, and alpha's logarithm."""
    roots = states[:, : WIDTH - 1].sqrt().clamp_min(LEAST_ROOT)
    return torch.cat((roots, states[:, WIDTH - 1 :].log()), 1)


def unrooted(rooted: Tensor, specular: Specular) -> Tensor:
    kd, ks = rooted[:, KD].square(), rooted[:, KS].square()
    if specular == "mono":
        ks = ks.mean(1, keepdim=True).expand_as(ks)
    return joined(kd, ks, rooted[:, -1].clamp(math.log(ALPHA_MIN), 0).exp())


def _values(rooted: Tensor, angles: Tensor, specular: Specular) -> Tensor:
    return torrance_sparrow.evaluate(*optics(unrooted(rooted, specular)), angles)
