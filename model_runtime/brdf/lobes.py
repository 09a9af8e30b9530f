"""Further lobes: what a diffuse term and one lobe do not show of a measured BRDF.

    f = Kd / pi + Ks rho(alpha) + sum_k w_k (c_k + (1 - c_k) (1 - cos theta_d)^5) rho'(alpha_k)
    c_k = color_k + (edge_k - color_k) (1 - cos_o)

The first lobe is that of `torrance_sparrow`. Each further one is a metal of Blender's Principled
BSDF, of base color c and weight w, with Schlick's Fresnel term: measured paints, papers and felts
reflect more towards grazing, which no number of flat lobes shows. c turns from a color to that of
the edge as the eye, not the light, nears the horizon, which a node can tell: fibers and paints of
flakes have other colors there. Where that shows nothing the two are one. rho' is Cycles' to the
digit, where heights correlate:

    rho' = D / (2 (cos_o s_i + cos_i s_o)),   s = sqrt(cos^2 + alpha^2 sin^2)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ..backend import Tensor, torch
from ..channels import ALPHA_MIN, FURTHER, LOBE, MOST_LOBES, WIDTH, optics, turning
from ..contract import Specular
from . import torrance_sparrow
from .half_angle import cosines
from .refinement import (
    LEAST_ROOT,
    WELL_HELD,
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
"""dB that a further lobe must gain, and one whose color turns over one that does not."""

_ALPHAS = (0.05, 0.2, 0.6)  # from which a further lobe sets out, and the first lobe's
_SHARES = ((0.95, 0.1), (0.7, 0.5))  # of the first lobe's roots that it keeps and hands on
_HORIZON = 1e-4  # where both directions lie in it, rho has no bound
_NOTHING = 1e-12  # a weight, that has a color all the same
_RISE = 0.3  # at first: root of what F90 is above the largest F0
_FIRST_STEPS, _LAST_STEPS, _FOLLOWING_STEPS = 5, 30, 6


@dataclass(frozen=True)
class LobedFit:
    """Fits [N, C + 8 K] of N measured BRDFs by 1 + K lobes: states, and of each further one what
    `LOBE` says, all at most 1; and how near each looks in `db` [N].
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
        """[N, K, 8]"""
        return _further(self.lobed)


def evaluate(lobed: Tensor, angles: Tensor) -> Tensor:
    """f [N, M, 3] per steradian of fits [N, C + 8 K] at `angles` [M, 3]."""
    f = torrance_sparrow.evaluate(*optics(lobed[:, :WIDTH]), angles)
    cos_i, cos_o, _, cos_d = (each.clamp(0, 1) for each in cosines(angles))
    grazing, facing = (1 - cos_d).pow(5)[:, None], (1 - cos_o)[:, None]
    for lobe in _lobes_of(lobed):
        color, edge, weight, alpha = _parts(lobe[:, None])
        base = color + (edge - color) * facing
        a2 = alpha[:, 0].square()
        s_i, s_o = ((c * c + a2 * (1 - c * c)).sqrt() for c in (cos_i, cos_o))
        rho = ggx(a2, angles) / (2 * (cos_o * s_i + cos_i * s_o).clamp_min(_HORIZON))
        f = f + weight * (base + (1 - base) * grazing) * rho[..., None]
    return f


def _further(lobed: Tensor) -> Tensor:
    return lobed[:, WIDTH:].unflatten(1, ((lobed.shape[1] - WIDTH) // FURTHER, FURTHER))


def _lobes_of(lobed: Tensor) -> tuple[Tensor, ...]:
    """The numbers [N, 8] of each of K further lobes."""
    return lobed[:, WIDTH:].split(FURTHER, 1) if lobed.shape[1] > WIDTH else ()


def _parts(lobe: Tensor) -> tuple[Tensor, ...]:
    """Color, edge, weight and alpha [..., 3 or 1] of lobes [..., 8]."""
    return tuple(lobe[..., place] for place in LOBE.values())


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
    """N BRDFs with a lobe more than `fit`, which has no weight where it would look farther off, and
    one color where a second adds little.
    """
    nothing = torch.cat((torch.zeros(len(fit.db), FURTHER - 1), fit.states[:, -1:]), 1)
    before = LobedFit(torch.cat((fit.lobed, nothing), 1), fit.db)
    starts, turns = _starts(_coordinates(fit.lobed)), turning(before.further)
    found = _nearer(before, _fit(measured, starts, turns, specular), 0.0)
    if bool((found.db >= WELL_HELD).all()):
        return found
    turns = torch.cat((turns[:, :-1], torch.ones_like(turns[:, :1])), 1)
    gain = torch.full_like(found.db, WORTHWHILE).masked_fill(found.db >= WELL_HELD, math.inf)
    return _nearer(found, _fit(measured, starts, turns, specular), gain)


def _nearer(fit: LobedFit, other: LobedFit, gain: Tensor | float) -> LobedFit:
    """Of each BRDF the `other` fit, where that looks nearer by more than `gain` dB."""
    nearer = other.db > fit.db + gain
    lobed = torch.where(nearer[:, None], other.lobed, fit.lobed)
    return LobedFit(lobed, torch.where(nearer, other.db, fit.db))


def _fit(
    measured: Measurements, starts: list[Tensor], turns: Tensor, specular: Specular
) -> LobedFit:
    """What is found from the most promising of `starts` [N, D], with lobes of which some turn their
    color, [N, K].
    """

    def values(x: Tensor, angles: Tensor) -> Tensor:
        return evaluate(_lobed(x, specular), angles)

    free = _free(turns)
    tried = [measured.nearest(x, values, _FIRST_STEPS, free) for x in starts]
    missed = torch.stack([measured.missed(x, values) for x in tried])
    best = torch.stack(tried)[missed.argmin(0), torch.arange(len(free))]
    found = _lobed(measured.nearest(best, values, _LAST_STEPS, free), specular)
    return LobedFit(found, measured.psnr(evaluate(found, other_views().angles)))


def following(
    lobed: Tensor, read: Callable[[int], Tensor], count: int, specular: Specular
) -> Tensor:
    """Fits [N, T, C + 8 K] of N BRDFs that change in `count` steps from about what `lobed` [N,
    C + 8 K] shows: each begins at the one before, so that lobes stay the same ones.

    read: step -> f [N, M, 3] at `views()`
    """

    def values(x: Tensor, angles: Tensor) -> Tensor:
        return evaluate(_lobed(x, specular), angles)

    x, free, found = _coordinates(lobed), _free(turning(_further(lobed))), []
    for step in range(count):
        x = nearest(read(step), x, values, _FOLLOWING_STEPS, free)
        found.append(_lobed(x, specular))
    return torch.stack(found, 1)


def _starts(x: Tensor) -> list[Tensor]:
    """Coordinates [N, D + 8] of fits with coordinates `x` [N, D] and a lobe more, from which it is
    looked for.
    """
    before, ks, log_alpha, after = x.split((3, 3, 1, x.shape[1] - WIDTH), 1)
    even, rise = torch.zeros_like(ks), torch.full_like(log_alpha, _RISE)
    alphas = (log_alpha, *(torch.full_like(rise, math.log(alpha)) for alpha in _ALPHAS))
    return [
        torch.cat((before, keep * ks, log_alpha, after, hand_on * ks, even, rise, alpha), 1)
        for alpha in alphas
        for keep, hand_on in _SHARES
    ]


def _coordinates(lobed: Tensor) -> Tensor:
    """[N, D] without bounds: those of the states, then of each further lobe the roots of what it
    reflects head-on (F0, three colors), what the edge's are more than these, the root of how much
    more than the largest of all the lobe reflects at grazing (F90), and alpha's logarithm.
    """
    parts = [rooted(lobed[:, :WIDTH])]
    for lobe in _lobes_of(lobed):
        color, edge, weight, alpha = _parts(lobe)
        rise = 1 - torch.cat((color, edge), 1).amax(1, keepdim=True)
        f0, at_edge, more = (
            (weight * each).sqrt().clamp_min(LEAST_ROOT) for each in (color, edge, rise)
        )
        parts += [f0, at_edge - f0, more, alpha.log()]
    return torch.cat(parts, 1)


def _free(turns: Tensor) -> Tensor:
    """[N, D]: 1 of coordinates that are looked for, 0 of edges of lobes that do not turn [N, K]."""
    count = len(turns)
    parts = [torch.ones(count, WIDTH)]
    for lobe in turns.float().split(1, 1):
        parts += [torch.ones(count, 3), lobe.expand(-1, 3), torch.ones(count, 2)]
    return torch.cat(parts, 1)


def _lobed(x: Tensor, specular: Specular) -> Tensor:
    """`_coordinates` the other way."""
    parts = [unrooted(x[:, :WIDTH], specular)]
    for lobe in _lobes_of(x):
        root, more, rise, log_alpha = lobe.split((3, 3, 1, 1), 1)
        ends = [each.square().clamp_max(1) for each in (root, root + more)]
        if specular == "mono":
            ends = [each.mean(1, keepdim=True).expand_as(each) for each in ends]
        most = torch.cat(ends, 1).amax(1, keepdim=True)
        f90 = (most + rise.square()).clamp(_NOTHING, 1)
        parts += [each / f90 for each in ends]
        parts += [f90, log_alpha.clamp(math.log(ALPHA_MIN), 0).exp()]
    return torch.cat(parts, 1)
