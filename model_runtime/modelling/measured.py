"""A measured material: the lobes that show it, and how these age."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ..backend import Tensor, torch
from ..brdf.fit import fit_angles, relative_error
from ..brdf.lobes import LobedFit, evaluate, fit_lobes, following
from ..brdf.measured import MeasuredBRDF
from ..brdf.refinement import Measurements, SeenFit, fit_seen
from ..brdf.views import views
from ..channels import ALPHA, ALPHA_MIN, FURTHER, KS, LOBE
from ..contract import TORRANCE_SPARROW, AgeRequest, Specular
from ..errors import InputError, shown
from ..maps import HALF_MAX
from ..representation.latents import Latents, Representation

__all__ = ("MeasuredFit", "anchored_lobes", "fit_measured", "follow_lobes")


@dataclass(frozen=True)
class MeasuredFit:
    """A measured material by `one` lobe, and by as many as show it (`lobed`), which may be one too;
    `error` is the relative RMS of the latter over directions.
    """

    one: SeenFit
    lobed: LobedFit
    error: float

    @property
    def db(self) -> float:
        """How near it looks."""
        return float(self.lobed.db[0])

    @cached_property
    def further(self) -> Tensor | None:
        """The lobes [K, 8] after the first; None without any."""
        return self.lobed.further[0] if self.lobed.lobes > 1 else None


def fit_measured(brdf: MeasuredBRDF, request: AgeRequest) -> MeasuredFit:
    """The fit of fewest lobes that shows `brdf` with the tolerance of `request`, or else the best;
    of formats that hold one lobe alone, with one. Raises InputError where it is beyond what maps
    hold.
    """

    def measured(angles: Tensor) -> Tensor:
        return brdf.evaluate(angles)[None]

    one = fit_seen(measured, request.specular)
    if not bool((one.states <= HALF_MAX).all()):  # nor NaN
        raise InputError(
            f"{shown(brdf.name)} reflects more than half floats hold.",
            "Choose another measurement, or scale its values.",
        )
    lobed = LobedFit.of(one)
    if request.format not in (None, TORRANCE_SPARROW) or one.db.min() >= request.tolerance:
        return MeasuredFit(one, lobed, float(one.error[0]))
    lobed = fit_lobes(Measurements.of(measured), lobed, request.tolerance, request.specular)
    error = relative_error(measured(fit_angles()), evaluate(lobed.lobed, fit_angles()))
    return MeasuredFit(one, lobed, float(error[0]))


def follow_lobes(
    lobed: Tensor,
    latents: Latents,
    ages: int,
    representation: Representation,
    specular: Specular,
) -> tuple[Tensor, float]:
    """Fits [1, T, C + 8 K] of `latents`, those of one material at `ages` T, decoded, by the lobes
    that it has at first, about `lobed` [1, C + 8 K]; and the largest relative error.
    """

    def decoded(angles: Tensor) -> Tensor:
        device = latents.shared.device
        return representation.decode(latents, angles.to(device)).to(lobed.device)

    seen = decoded(views().angles)
    found = following(lobed, lambda age: seen[age : age + 1], ages, specular)
    shows = evaluate(found[0], fit_angles())
    return found, float(relative_error(decoded(fit_angles()), shows).max())


def anchored_lobes(further: Tensor, histories: Tensor | None, gain: Tensor) -> Tensor:
    """Further lobes [..., T, K, 8] at each age, of materials that have `further` [..., K, 8] at
    first.

    As `compose.anchored` has it of states: `histories` [..., T, K, 8] are those that a
    representation tells, and what they lack at first lives on as the `gain` [T, C] lets differences
    live. Where none are told, lobes fade so, and keep their colors and width.
    """
    mean = gain[:, KS].mean(1, keepdim=True)
    if histories is None:
        fading = torch.ones(len(gain), FURTHER)
        fading[:, LOBE["weight"]] = mean
        found = fading[:, None] * further[..., None, :, :]
    else:
        own = torch.cat((gain[:, KS], gain[:, KS], mean, gain[:, ALPHA]), 1)
        missing = further[..., None, :, :] - histories[..., :1, :, :]
        found = histories + own[:, None] * missing
    found = found.clamp(0, 1)
    found[..., LOBE["alpha"]] = found[..., LOBE["alpha"]].clamp_min(ALPHA_MIN)
    return found
