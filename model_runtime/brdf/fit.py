"""Torrance-Sparrow parameters of any BRDF: what textures can hold of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..backend import Tensor, torch
from ..channels import ALPHA_MIN
from ..contract import Specular
from ..states import joined
from .half_angle import above_horizon, cosines
from .torrance_sparrow import unbounded_lobe

__all__ = (
    "Fit",
    "Fitter",
    "at_a_time",
    "fit_angles",
    "fit_torrance_sparrow",
    "relative_error",
)

_ALPHAS = 79
_SPACING = -math.log(ALPHA_MIN) / (_ALPHAS - 1)  # of log alpha
_BESIDE = 8  # alphas on each side of one with which polynomials are right to 9 digits
_TERMS = 10  # of these polynomials that matter between two neighbors
_ROUNDS, _PARTS = 3, 8  # how often, and into how many parts, what is left is divided


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


def fit_torrance_sparrow(
    f: Tensor, angles: Tensor | None = None, *, specular: Specular = "rgb"
) -> Fit:
    """Fit N BRDFs given as `f` [N, M, 3] per steradian at `angles` [M, 3] (`fit_angles()`).

    Samples that are not finite are left out. With "mono", one Ks serves all channels.
    """
    return Fitter(angles, specular=specular).fit(f)


def relative_error(f: Tensor, shown: Tensor) -> Tensor:
    """The error [N] that `Fit` has, of any values `shown` [N, M, 3] as a fit of `f` [N, M, 3], both
    at `fit_angles()`.
    """
    f, weights = _weighed(f, fit_angles().double())
    missing = f - shown.double().transpose(1, 2)
    left, whole = ((weights[:, None] * x.square()).sum((1, 2)) for x in (missing, f))
    return (left / whole.clamp_min(torch.finfo(whole.dtype).tiny)).sqrt().float()


def _weighed(f: Tensor, angles: Tensor) -> tuple[Tensor, Tensor]:
    """`f` [N, M, 3] as [N, 3, M] with 0 for what is not finite, and how much each direction
    [N, M] counts.
    """
    f = f.transpose(1, 2)
    finite = torch.isfinite(f.sum(1))
    f = torch.where(finite[:, None], f, torch.zeros_like(f)).clamp_min(0)
    cos_i, cos_o, _, _ = cosines(angles)
    brightness = f.mean(1)
    floor = 0.05 * brightness.median(1, keepdim=True).values + 1e-4
    weights = finite * (cos_i * cos_o).clamp(0, 1) / (brightness + floor).double().square()
    return f.double(), weights


@dataclass(frozen=True)
class _Sums:
    """Sums over directions, with weights w, that do not depend on alpha.

    products: [N, 4, M] w f and w / pi, which are summed with lobes
    diffuse, diffuse_f, square: [N, 1, 1] of w / pi^2, [N, 3, 1] of w f / pi, [N] of w f^2
    mono: whether one Ks serves all channels
    """

    products: Tensor
    diffuse: Tensor
    diffuse_f: Tensor
    square: Tensor
    mono: bool

    @classmethod
    def of(cls, f: Tensor, weights: Tensor, *, mono: bool) -> _Sums:
        """Those of `f` [N, 3, M] and w [N, M]."""
        products = torch.cat((f, torch.full_like(weights, 1 / math.pi)[:, None]), 1)
        products *= weights[:, None]
        square = (products[:, :3] * f).sum((1, 2))
        total = products.sum(2, keepdim=True) / math.pi
        return cls(products, total[:, 3:], total[:, :3], square, mono)

    def with_lobes(self, lobes: Tensor) -> Tensor:
        """[N, 5, K]: of w rho f, w rho / pi and w rho^2 for `lobes` rho [K, M]."""
        once = (self.products.flatten(0, 1) @ lobes.T).unflatten(0, (-1, 4))
        twice = self.products[:, 3] @ (lobes.square() * math.pi).T
        return torch.cat((once, twice[:, None]), 1)

    def solve(self, lobes: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Best Kd, Ks >= 0 [N, 3, K] and the squared error [N, K] that is left, with each of K
        lobes whose sums [N, 5, K] are given.
        """
        a, p = self.diffuse, self.diffuse_f
        q, b, c = lobes[:, :3], lobes[:, 3:4], lobes[:, 4:]
        share, ks = b / a, torch.zeros_like(q)
        # Newton's method for the Ks where the error's slope is 0; that bends where a Kd reaches 0.
        for _ in range(4 if self.mono else 2):
            free = share * ks < p / a
            excess = q - free * (share * p)
            curvature = (c - free * (share * b)).clamp_min(1e-12 * c)
            if self.mono:
                excess, curvature = (x.mean(1, keepdim=True) for x in (excess, curvature))
            ks = (excess / curvature).clamp_min(0).expand_as(q)
        missing = p - b * ks
        kd = (missing / a).clamp_min(0)
        error = kd * (kd * a - 2 * missing) + ks * (ks * c - 2 * q)
        return kd, ks, error.sum(1) + self.square[:, None]


class Fitter:
    """Fits BRDFs given at `angles` [M, 3] (`fit_angles()` by default), however many there are.

    Least squares of the relative error. For a given alpha, Kd and Ks are linear and solved in
    closed form with Kd, Ks >= 0, from a few sums over directions. What is left is a function of
    alpha alone. Its least value is looked for among 79 alphas, evenly spaced in their logarithm,
    then between the neighbors of the best, where the sums are close to polynomials of log alpha.
    """

    def __init__(self, angles: Tensor | None = None, *, specular: Specular = "rgb") -> None:
        self.angles = (fit_angles() if angles is None else angles).double()
        self._mono = specular == "mono"
        device = self.angles.device
        places = torch.arange(-_BESIDE, _ALPHAS + _BESIDE).double().to(device)
        self._lobes = unbounded_lobe((places * _SPACING).exp() * ALPHA_MIN, self.angles)
        self._window = torch.arange(2 * _BESIDE + 1).to(device)
        nodes = torch.linspace(-1, 1, 2 * _BESIDE + 1, dtype=torch.float64)
        powers = nodes[:, None] ** torch.arange(len(nodes)).double()
        to_powers = torch.linalg.solve(powers, torch.eye(len(nodes)).double())
        self._to_coefficients = to_powers[:_TERMS].T.to(device)

    def fit(self, f: Tensor) -> Fit:
        """Of N BRDFs `f` [N, M, 3]."""
        parts = [self._fit(part) for part in f.split(at_a_time(f.device))]
        return Fit(*(torch.cat(column) for column in zip(*parts, strict=True)))

    def _fit(self, f: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        sums = _Sums.of(*_weighed(f, self.angles), mono=self._mono)
        lobes = sums.with_lobes(self._lobes)
        _, _, error = sums.solve(lobes[:, :, _BESIDE:-_BESIDE])
        place = error.argmin(1)
        rows = torch.arange(len(f)).to(f.device)[:, None]
        near = lobes[rows, :, place[:, None] + self._window].transpose(1, 2)
        kd, ks, error, away = _refined(
            sums,
            near @ self._to_coefficients,
            (place > 0).to(error.dtype) / -_BESIDE,
            (place < _ALPHAS - 1).to(error.dtype) / _BESIDE,
        )
        alpha = ((place + _BESIDE * away) * _SPACING).exp() * ALPHA_MIN
        whole = sums.square.clamp_min(torch.finfo(error.dtype).tiny)
        relative = (error.clamp_min(0) / whole).sqrt()
        return kd.float(), ks.float(), alpha.clamp(ALPHA_MIN, 1).float(), relative.float()


def at_a_time(device: torch.device) -> int:
    """How many BRDFs are worked on together: few on a CPU, where they stay in the cache."""
    return 512 if device.type == "cpu" else 8192


def _refined(
    sums: _Sums, coefficients: Tensor, first: Tensor, last: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Kd, Ks [N, 3], squared error and place [N] of the least error, between the places `first` and
    `last` [N], where the sums with lobes are polynomials of the place: `coefficients` [N, 5, J].
    """
    rows = torch.arange(len(coefficients)).to(coefficients.device)
    parts = torch.linspace(0, 1, _PARTS + 1, dtype=torch.float64).to(coefficients.device)
    share = torch.zeros_like(first)
    for _ in range(_ROUNDS):
        places = first[:, None] + (last - first)[:, None] * parts
        lobes, change = _polynomials(coefficients, places)
        kd, ks, error = sums.solve(lobes)
        slope = _slope(kd, ks, change)
        best = error.argmin(1)
        left = (best - (slope[rows, best] > 0).long()).clamp(0, _PARTS - 1)
        first, last = places[rows, left], places[rows, left + 1]
        down, up = slope[rows, left], slope[rows, left + 1]
        share = torch.where((down < 0) & (up > 0), down / (down - up), (best - left).to(down.dtype))
    place = first + (last - first) * share
    kd, ks, error = sums.solve(_polynomials(coefficients, place[:, None])[0])
    return kd[..., 0], ks[..., 0], error[:, 0], place


def _polynomials(coefficients: Tensor, places: Tensor) -> tuple[Tensor, Tensor]:
    """Values and slopes [N, 5, K] at `places` [N, K] of polynomials, by Horner's scheme."""
    places = places[:, None]
    value = slope = torch.zeros_like(places)
    for k in reversed(range(coefficients.shape[2])):
        slope = slope * places + value
        value = value * places + coefficients[:, :, k : k + 1]
    return value, slope


def _slope(kd: Tensor, ks: Tensor, change: Tensor) -> Tensor:
    """Slope [N, K] of the squared error by alpha where the sums with lobes have slopes `change`
    [N, 5, K]. Kd and Ks [N, 3, K] are best, or held at 0: the error has no slope by them.
    """
    q, b, c = change[:, :3], change[:, 3:4], change[:, 4:]
    return (ks * (ks * c + 2 * (kd * b - q))).sum(1)
