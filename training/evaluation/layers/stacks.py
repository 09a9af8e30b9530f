"""The films and grounds that are compared, and laws of what a film does to a ground.

All laws keep what the boundary itself reflects. Of what passes it twice `multiplied` takes what the
film absorbs on the way straight through, exp(-2 d), off body and highlight. `film` takes the body
by the law of `films`, by which yellowing is made. `refracted` follows light along the directions
that refraction leaves to it: the body by the same law, told for a pair of directions, and the
highlight as the ground has it for the pair inside the film, blurred by the facets of the boundary
(after Weidlich and Wilkie, Arbitrarily Layered Micro-Facet Surfaces, GRAPHITE 2007). `film_state`
is what `film` can say with one lobe, as textures hold it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from model_runtime.brdf.half_angle import directions, from_directions
from model_runtime.brdf.torrance_sparrow import evaluate
from model_runtime.states import joined

from ...data.films import fresnel, ground_under, returned, seen_through
from ...data.walks import Film, Ground, boundary

__all__ = (
    "GROUNDS",
    "Stacks",
    "film",
    "film_state",
    "multiplied",
    "refracted",
    "under_varnish",
)

Array = NDArray[np.floating]

_IOR = 1.5
_PASSED = 1 - ((_IOR - 1) / (_IOR + 1)) ** 2  # as states count it: 1 - ks
_DEPTH = np.array([0.03, 0.11, 0.48])  # of varnish that has yellowed as far as ours does


@dataclass(frozen=True)
class _Ground:
    """The body's color under a clear film, and the highlight that it has without one."""

    body: tuple[float, float, float]
    ks: tuple[float, float, float] = (0.0, 0.0, 0.0)
    alpha: float = 0.5


_NONE = (0.0, 0.0, 0.0)
_GROUNDS = {
    "white lead": _Ground((0.75, 0.72, 0.68)),
    "red earth": _Ground((0.45, 0.20, 0.10)),
    "azurite": _Ground((0.10, 0.20, 0.50)),
    "bone black": _Ground((0.06, 0.05, 0.04)),
    "glossy red paint": _Ground((0.45, 0.06, 0.04), (0.04, 0.04, 0.04), 0.2),
    "gold": _Ground(_NONE, (1.0, 0.78, 0.34), 0.1),
    "copper": _Ground(_NONE, (0.95, 0.64, 0.54), 0.2),
    "rough steel": _Ground(_NONE, (0.56, 0.57, 0.58), 0.4),
}
GROUNDS = tuple(_GROUNDS)
"""Their names; the first four are matte."""


@dataclass(frozen=True)
class Stacks:
    """n grounds under a varnish; `body` [n, 3] is what shows of their bodies while it is clear."""

    film: Film
    ground: Ground
    body: Array


def under_varnish(alpha: float, age: float, names: Sequence[str] = GROUNDS) -> Stacks:
    """Grounds by their `names` under a varnish whose boundary has this alpha, at a share `age` of
    the depth that ours gets.
    """
    grounds = [_GROUNDS[name] for name in names]
    body = np.array([each.body for each in grounds])
    depth = torch.from_numpy(age * _DEPTH).float().expand(len(grounds), 3)
    ground = Ground(
        torch.from_numpy(ground_under(body, _IOR)).float(),
        torch.tensor([each.ks for each in grounds]),
        torch.tensor([each.alpha for each in grounds]),
    )
    return Stacks(Film(torch.full((len(grounds),), alpha), depth, _IOR), ground, body)


def multiplied(stacks: Stacks, angles: Tensor) -> Tensor:
    """f [n, M, 3] at `angles` [M, 3] of bodies and highlights that are crossed twice."""
    body = torch.from_numpy(stacks.body).float() * torch.exp(-2 * stacks.film.depth)
    return _through(stacks, body, angles)


def film(stacks: Stacks, angles: Tensor) -> Tensor:
    """f [n, M, 3] at `angles` [M, 3] by the law of films, with highlights crossed twice."""
    return _through(stacks, _seen(stacks), angles)


def film_state(stacks: Stacks) -> Tensor:
    """States [n, C]: the same in one lobe, that has the highlights' sum and their mean width."""
    below, above = _below(stacks), 1 - _PASSED
    whole = below + above
    share = (below / whole).mean(1)
    alpha = torch.lerp(stacks.film.alpha.log(), stacks.ground.alpha.log(), share).exp()
    return joined(_PASSED * _seen(stacks), whole, alpha)


def refracted(stacks: Stacks, angles: Tensor) -> Tensor:
    """f [n, M, 3] at `angles` [M, 3] by what refraction leaves of a pair of directions."""
    film, ground = stacks.film, stacks.ground
    passed, inside = 1.0, []
    for direction in directions(angles):
        cosine = direction[:, 2].clamp(0, 1)
        below = direction[:, :2] / _IOR
        up = (1 - below.square().sum(1)).sqrt()
        let_in = 1 - torch.from_numpy(fresnel(cosine.numpy(), _IOR))
        slanted = torch.exp(-film.depth[:, None] / up[:, None])
        passed = passed * let_in[:, None] * slanted
        inside.append(torch.cat((below, up[:, None]), 1))
    back = torch.from_numpy(returned(film.depth.double().numpy(), _IOR)).float()
    again = 1 - back * ground.kd  # that is reflected inside and scattered once more
    bent = 2 * ((_IOR - 1) / (2 * _IOR) * film.alpha).square()  # slopes, of two crossings
    alpha = (ground.alpha.square() + bent).sqrt().clamp_max(1)
    seen = evaluate(ground.kd / again, ground.ks, alpha, from_directions(*inside))
    return boundary(film, angles) + passed * seen / _IOR**2


def _seen(stacks: Stacks) -> Tensor:
    """Bodies [n, 3] by the law of films."""
    under, depth = ground_under(stacks.body, _IOR), stacks.film.depth.double().numpy()
    return torch.from_numpy(seen_through(under, depth, _IOR)).float()


def _below(stacks: Stacks) -> Tensor:
    """Ks [n, 3] of the highlights below, as they show."""
    return _PASSED**2 * stacks.ground.ks * torch.exp(-2 * stacks.film.depth)


def _through(stacks: Stacks, body: Tensor, angles: Tensor) -> Tensor:
    """The boundary, the body as it shows, and the highlight of what passes."""
    below = evaluate(_PASSED * body, _below(stacks), stacks.ground.alpha, angles)
    return boundary(stacks.film, angles) + below
