"""Torrance-Sparrow parameters of any BRDF: what textures can hold of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..backend import Tensor, torch
from ..channels import ALPHA_MIN, optics
from ..contract import Specular
from ..states import joined
from .half_angle import above_horizon, cosines
from .torrance_sparrow import evaluate, specular_lobe

__all__ = ("USUAL", "Fit", "FitEffort", "fit_angles", "fit_torrance_sparrow", "relative_error")


_CHUNK = 4096


@dataclass(frozen=True)
class FitEffort:
    """How many alphas are tried, how often the best is refined, and in which precision."""

    candidates: int = 40
    refinements: int = 5
    precision: torch.dtype = torch.float64


USUAL = FitEffort()


@dataclass(frozen=True)
class Fit:
    """`kd`, `ks` [N, 3] >= 0, `alpha` [N] in [1e-4, 1] and the relative RMS `error` [N] of
    the fit.
    """

    kd: Tensor
    ks: Tensor
    alpha: Tensor
    error: Tensor

    def parameters(self) -> Tensor:
        """As states [N, C]."""
        return joined(self.kd, self.ks, self.alpha)


def fit_angles() -> Tensor:
    """The directions [M, 3] (M about 300) at which `fit_torrance_sparrow` wants the BRDF.

    theta_h = u^3 pi/2 for evenly spaced u, from a hundredth of a degree to grazing, so that lobes
    of every width have samples on their slope.
    """
    u = (torch.arange(30) + 0.5) / 30
    theta_d = torch.tensor((0.05, 0.5, 0.9, 1.2))
    phi_d = torch.tensor((0.0, 0.25, 0.5)) * math.pi
    grid = torch.stack(torch.meshgrid(u**3 * math.pi / 2, theta_d, phi_d, indexing="ij"), -1)
    grid = grid.reshape(-1, 3)
    return grid[above_horizon(grid, margin=0.1)]


@dataclass(frozen=True)
class _Moments:
    """Weighted sums over directions that the linear problem needs; f is [N, M, 3], weights
    [N, M].
    """

    weights: Tensor
    weighted: Tensor
    square: Tensor
    diffuse: Tensor
    diffuse_f: Tensor

    @classmethod
    def of(cls, f: Tensor, weights: Tensor) -> _Moments:
        weighted = weights[..., None] * f
        return cls(
            weights,
            weighted,
            (weighted * f).sum(1),
            weights.sum(1) / math.pi**2,
            weighted.sum(1) / math.pi,
        )


def _solve(
    moments: _Moments, cross: Tensor, lobe: Tensor, lobe_f: Tensor, specular: Specular
) -> tuple[Tensor, Tensor, Tensor]:
    """Best Kd, Ks >= 0 for lobes whose sums are given, and the squared error that is left.

    `cross`, `lobe` [N, K] are sums of w rho / pi and w rho^2, `lobe_f` [N, K, 3] of w rho f, for K
    candidate alphas. Returns kd, ks [N, K, 3] and error [N, K].
    """
    a, b, c = moments.diffuse[:, None, None], cross[..., None], lobe[..., None]
    p, q = moments.diffuse_f[:, None], lobe_f
    excess = q - b * p / a
    curvature = (c - b * b / a).clamp_min(1e-12 * c)
    if specular == "mono":
        ks = (excess.mean(-1, keepdim=True) / curvature).expand_as(q)
    else:
        ks = excess / curvature
    ks = ks.clamp_min(0)
    kd = ((p - b * ks) / a).clamp_min(0)
    lone = q / c
    lone = lone.mean(-1, keepdim=True).expand_as(q) if specular == "mono" else lone
    ks = (
        torch.where(kd > 0, ks, lone)
        if specular == "rgb"
        else torch.where((kd > 0).any(-1, keepdim=True), ks, lone)
    )
    error = (
        moments.square[:, None]
        - 2 * (kd * p + ks * q)
        + kd * kd * a
        + 2 * kd * ks * b
        + ks * ks * c
    )
    return kd, ks, error.sum(-1)


def fit_torrance_sparrow(
    f: Tensor,
    angles: Tensor | None = None,
    *,
    specular: Specular = "rgb",
    effort: FitEffort = USUAL,
) -> Fit:
    """Fit N BRDFs given as `f` [N, M, 3] per steradian at `angles` [M, 3] (`fit_angles()`).

    Least squares of the relative error. For a given alpha, Kd and Ks are linear and solved in
    closed form with Kd, Ks >= 0; alpha is found on a logarithmic grid (of 40) and refined by
    Gauss-Newton steps. Samples that are not finite are left out. With "mono", one Ks serves all
    channels.
    """
    angles = fit_angles() if angles is None else angles
    parts = [
        _fit_chunk(f[start : start + _CHUNK], angles, specular, effort)
        for start in range(0, len(f), _CHUNK)
    ]
    return Fit(*(torch.cat(column) for column in zip(*parts, strict=True)))


def relative_error(f: Tensor, states: Tensor) -> Tensor:
    """The error [N] that `Fit` has, of any `states` [N, C] as a fit of `f` [N, M, 3] at
    `fit_angles()`.
    """
    angles = fit_angles().double()
    f, weights = _weighed(f.double(), angles)
    missing = f - evaluate(*optics(states.double()), angles)
    left, whole = ((weights[..., None] * x.square()).sum((1, 2)) for x in (missing, f))
    return (left / whole.clamp_min(torch.finfo(whole.dtype).tiny)).sqrt().float()


def _weighed(f: Tensor, angles: Tensor) -> tuple[Tensor, Tensor]:
    """`f` [N, M, 3] with 0 for what is not finite, and how much each direction [N, M] counts."""
    finite = torch.isfinite(f).all(-1)
    f = torch.where(finite[..., None], f, torch.zeros_like(f)).clamp_min(0)
    cos_i, cos_o, _, _ = cosines(angles)
    brightness = f.mean(-1)
    floor = 0.05 * brightness.median(1, keepdim=True).values + 1e-4
    return f, finite * (cos_i * cos_o).clamp(0, 1) / (brightness + floor).square()


def _fit_chunk(
    f: Tensor, angles: Tensor, specular: Specular, effort: FitEffort
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    f, angles = f.to(effort.precision), angles.to(effort.precision)
    f, weights = _weighed(f, angles)
    moments = _Moments.of(f, weights)

    grid = torch.linspace(math.log(ALPHA_MIN), 0, effort.candidates, dtype=f.dtype, device=f.device)
    lobes = specular_lobe(grid.exp(), angles)
    cross = weights @ lobes.T / math.pi
    square = weights @ lobes.square().T
    lobe_f = torch.einsum("nmc,km->nkc", moments.weighted, lobes)
    _, _, error = _solve(moments, cross, square, lobe_f, specular)
    log_alpha = grid[error.argmin(1)]

    def solve(lobe: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Best kd, ks [N, 3] and error [N] for one lobe [N, M] a BRDF."""
        kd, ks, error = _solve(
            moments,
            ((weights * lobe).sum(1) / math.pi)[:, None],
            (weights * lobe.square()).sum(1)[:, None],
            torch.einsum("nmc,nm->nc", moments.weighted, lobe)[:, None],
            specular,
        )
        return kd[:, 0], ks[:, 0], error[:, 0]

    lobe = specular_lobe(log_alpha.exp(), angles)
    kd, ks, best = solve(lobe)
    reach = torch.full_like(best, -math.log(ALPHA_MIN) / (effort.candidates - 1))
    for _ in range(effort.refinements):
        step = _gauss_newton_step(f, weights, kd, ks, lobe, log_alpha, angles)
        trial_alpha = (log_alpha + step.clamp(-reach, reach)).clamp(math.log(ALPHA_MIN), 0)
        trial_lobe = specular_lobe(trial_alpha.exp(), angles)
        trial_kd, trial_ks, trial = solve(trial_lobe)
        better = trial < best
        log_alpha = torch.where(better, trial_alpha, log_alpha)
        lobe = torch.where(better[:, None], trial_lobe, lobe)
        kd = torch.where(better[:, None], trial_kd, kd)
        ks = torch.where(better[:, None], trial_ks, ks)
        best = torch.where(better, trial, best)
        reach = torch.where(better, reach, reach / 4)
    tiny = torch.finfo(effort.precision).tiny
    scale = moments.square.sum(-1).clamp_min(tiny)
    relative = (best.clamp_min(0) / scale).sqrt()
    return kd.float(), ks.float(), log_alpha.exp().float(), relative.float()


def _gauss_newton_step(
    f: Tensor,
    weights: Tensor,
    kd: Tensor,
    ks: Tensor,
    lobe: Tensor,
    log_alpha: Tensor,
    angles: Tensor,
) -> Tensor:
    """Change [N] of log alpha that lowers the error most, Kd and Ks following (variable
    projection).
    """
    nudge, tiny = 1e-4, torch.finfo(f.dtype).tiny
    slope = (specular_lobe((log_alpha + nudge).exp(), angles) - lobe) / nudge
    a = weights.sum(1)
    mean_lobe = (weights * lobe).sum(1, keepdim=True) / a[:, None]
    mean_slope = (weights * slope).sum(1, keepdim=True) / a[:, None]
    centerd, moved = lobe - mean_lobe, slope - mean_slope
    along = (weights * centerd * moved).sum(1) / (weights * centerd.square()).sum(1).clamp_min(tiny)
    moved = moved - along[:, None] * centerd
    missing = f - kd[:, None] / math.pi - ks[:, None] * lobe[..., None]
    gain = torch.einsum("nm,nmc,nc->n", weights * moved, missing, ks)
    return gain / ((weights * moved.square()).sum(1) * ks.square().sum(1)).clamp_min(tiny)
