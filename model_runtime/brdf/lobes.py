"""Further lobes: what a diffuse term and one lobe do not show of a measured BRDF.

    f = Kd / pi + Ks rho(alpha) + sum_k w_k (c_k + (1 - c_k) (1 - cos theta_d)^5) rho'(alpha_k)

The first lobe is that of `torrance_sparrow`. Each further one is a metal of Blender's Principled
BSDF, of color c and weight w, with Schlick's Fresnel term: measured paints, papers and felts
reflect more towards grazing, which no number of flat lobes shows. Its rho' is Cycles' to the digit,
where heights correlate:

    rho' = D / (2 (cos_o s_i + cos_i s_o)),   s = sqrt(cos^2 + alpha^2 sin^2)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ..backend import Tensor, torch
from ..channels import ALPHA_MIN, FURTHER, MOST_LOBES, WIDTH, optics
from ..contract import Specular
from . import torrance_sparrow
from .half_angle import cosines
from .refinement import (
    LEAST_ROOT,
    Measurements,
    SeenFit,
    nearest,
    rooted,
    unrooted,
)
from .torrance_sparrow import ggx
from .views import other_views

__all__ = (
    "LobedFit",
    "evaluate",
    "fit_lobes",
    "following",
    "one_more",
)

WORTHWHILE = 0.5
"""dB that a further lobe must gain."""

_ALPHAS = (0.05, 0.2, 0.6)  # from which a further lobe sets out, and the first lobe's
_SHARES = ((0.95, 0.1), (0.7, 0.5))  # of the first lobe's roots that it keeps and hands on
_HORIZON = 1e-4  # where both directions lie in it, rho has no bound
_NOTHING = 1e-12  # a weight, that has a color all the same
_RISE = 0.3  # at first: root of what F90 is above the largest F0
_FIRST_STEPS, _LAST_STEPS, _FOLLOWING_STEPS = 5, 30, 6


@dataclass(frozen=True)
class LobedFit:
    """Fits [N, C + 5 K] of N measured BRDFs by 1 + K lobes: states, and of each further one color
    and weight, which are at most 1, and alpha; and how near each looks in `db` [N].
    """

    lobed: Tensor
    db: Tensor

    @classmethod
    def of(cls, seen: SeenFit) -> LobedFit:
        """One lobe."""
        return cls(seen.states, seen.db)

    @property
    def lobes(self) -> int:
        """1 + K."""
        return 1 + (self.lobed.shape[1] - WIDTH) // FURTHER

    @property
    def states(self) -> Tensor:
        """[N, C]: the diffuse term and the first lobe."""
        return self.lobed[:, :WIDTH]

    @property
    def further(self) -> Tensor:
        """[N, K, 5]"""
        return self.lobed[:, WIDTH:].unflatten(1, (self.lobes - 1, FURTHER))


def evaluate(lobed: Tensor, angles: Tensor) -> Tensor:
    """f [N, M, 3] per steradian of fits [N, C + 5 K] at `angles` [M, 3]."""
    f = torrance_sparrow.evaluate(*optics(lobed[:, :WIDTH]), angles)
    cos_i, cos_o, _, cos_d = (each.clamp(0, 1) for each in cosines(angles))
    grazing = (1 - cos_d).pow(5)[:, None]
    for lobe in _lobes_of(lobed):
        color, weight, a2 = lobe[:, None, :3], lobe[:, None, 3:4], lobe[:, 4:].square()
        s_i, s_o = ((c * c + a2 * (1 - c * c)).sqrt() for c in (cos_i, cos_o))
        rho = ggx(a2, angles) / (2 * (cos_o * s_i + cos_i * s_o).clamp_min(_HORIZON))
        f = f + weight * (color + (1 - color) * grazing) * rho[..., None]
    return f


def _lobes_of(lobed: Tensor) -> tuple[Tensor, ...]:
    """The numbers [N, 5] of each of K further lobes."""
    return lobed[:, WIDTH:].split(FURTHER, 1) if lobed.shape[1] > WIDTH else ()


def fit_lobes(
    measured: Measurements, one: LobedFit, tolerance: float, specular: Specular = "rgb"
) -> LobedFit:
    """The fit of fewest lobes that shows a measured BRDF with `tolerance` dB, or else one to which
    no further lobe adds much; `one` lobe, where that suffices, is left as it is.
    """
    best = one
    while float(best.db.min()) < tolerance and best.lobes < MOST_LOBES:
        more = one_more(measured, best, specular)
        if float((more.db - best.db).max()) < WORTHWHILE:
            break
        best = more
    return best


def one_more(measured: Measurements, fit: LobedFit, specular: Specular = "rgb") -> LobedFit:
    """N BRDFs with a lobe more than `fit`, which has no weight where it would look farther off."""

    def values(x: Tensor, angles: Tensor) -> Tensor:
        return evaluate(_lobed(x, specular), angles)

    start = _coordinates(fit.lobed)
    tried = [measured.nearest(x, values, _FIRST_STEPS) for x in _starts(start)]
    missed = torch.stack([measured.missed(x, values) for x in tried])
    rows = torch.arange(len(start))
    best = torch.stack(tried)[missed.argmin(0), rows]
    found = _lobed(measured.nearest(best, values, _LAST_STEPS), specular)
    db = measured.psnr(evaluate(found, other_views().angles))
    nothing = torch.cat((torch.zeros(len(start), 4), fit.states[:, -1:]), 1)
    before = torch.cat((fit.lobed, nothing), 1)
    nearer = db > fit.db
    return LobedFit(torch.where(nearer[:, None], found, before), torch.where(nearer, db, fit.db))


def following(
    lobed: Tensor, read: Callable[[int], Tensor], count: int, specular: Specular
) -> Tensor:
    """Fits [N, T, C + 5 K] of N BRDFs that change in `count` steps from about what `lobed` [N,
    C + 5 K] shows: each begins at the one before, so that lobes stay the same ones.

    read: step -> f [N, M, 3] at `views()`
    """

    def values(x: Tensor, angles: Tensor) -> Tensor:
        return evaluate(_lobed(x, specular), angles)

    x, found = _coordinates(lobed), []
    for step in range(count):
        x = nearest(read(step), x, values, _FOLLOWING_STEPS)
        found.append(_lobed(x, specular))
    return torch.stack(found, 1)


def _starts(x: Tensor) -> list[Tensor]:
    """Coordinates [N, D + 5] of fits with coordinates `x` [N, D] and a lobe more, from which it is
    looked for.
    """
    before, ks, log_alpha, after = x.split((3, 3, 1, x.shape[1] - WIDTH), 1)
    rise = torch.full_like(log_alpha, _RISE)
    alphas = (log_alpha, *(torch.full_like(rise, math.log(alpha)) for alpha in _ALPHAS))
    return [
        torch.cat((before, keep * ks, log_alpha, after, hand_on * ks, rise, alpha), 1)
        for alpha in alphas
        for keep, hand_on in _SHARES
    ]


def _coordinates(lobed: Tensor) -> Tensor:
    """[N, D] without bounds: those of the states, then of each further lobe the roots of what it
    reflects head-on (F0, three colors) and of how much more than the largest of these at grazing
    (F90), and alpha's logarithm.
    """
    parts = [rooted(lobed[:, :WIDTH])]
    for lobe in _lobes_of(lobed):
        color, weight, alpha = lobe.split((3, 1, 1), 1)
        rise = 1 - color.amax(1, keepdim=True)
        roots = (weight * torch.cat((color, rise), 1)).sqrt().clamp_min(LEAST_ROOT)
        parts += [roots, alpha.log()]
    return torch.cat(parts, 1)


def _lobed(x: Tensor, specular: Specular) -> Tensor:
    """`_coordinates` the other way."""
    parts = [unrooted(x[:, :WIDTH], specular)]
    for lobe in _lobes_of(x):
        f0 = lobe[:, :3].square().clamp_max(1)
        if specular == "mono":
            f0 = f0.mean(1, keepdim=True).expand_as(f0)
        f90 = (f0.amax(1, keepdim=True) + lobe[:, 3:4].square()).clamp(_NOTHING, 1)
        parts += [f0 / f90, f90, lobe[:, 4:].clamp(math.log(ALPHA_MIN), 0).exp()]
    return torch.cat(parts, 1)
