"""STAF: space-time appearance factorisation, one curve of change for a whole material.

J. Gu, C.-I Tu, R. Ramamoorthi, P. Belhumeur, W. Matusik, S. Nayar: Time-varying Surface Appearance:
Acquisition, Modeling and Rendering. ACM Transactions on Graphics 25(3), 2006. Each of the seven
parameters (Kd and Ks per channel, alpha) is factorised by itself, as in their database:

    p(x,y,t) = A(x,y) phi(R(x,y) t - O(x,y)) + D(x,y)

with a curve phi shared by all texels, there as here a polynomial of degree 6.

The factors leave four freedoms, fixed so: phi(0) = 0 and its extreme over [0, 1] is 1; the rates R
have median 1 and the offsets O median 0, over the texels that phi is fitted to. Where phi is a line
(or, for one direction, a parabola) R and O say no more than A and D: they stay near 1 and 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray

from model_runtime.errors import InputError
from model_runtime.maps import TorranceSparrowMaps
from training.data.sequences import Sequence

__all__ = ("Factors", "STAFModel", "fit")

Doubles = NDArray[np.float64]

_FACTORS = 4
_DEGREE = 6
_MOST_TEXELS = 1024
_MOST_STARTS = 64
_ROUNDS = 60
_STEPS = 15
_BOUNDS = ((0.25, -1.0), (4.0, 1.0))
_STILL = 1e-6
_TINY = 1e-15


@dataclass(frozen=True)
class Factors:
    """One parameter's history but for D: A phi(R t - O).

    phi: the shared curve
    amplitude, rate, offset: A, R, O of every texel, [H, W]
    """

    phi: Chebyshev
    amplitude: Doubles
    rate: Doubles
    offset: Doubles

    def history(self, start: NDArray[np.float32], times: Doubles) -> Doubles:
        """The values at `times` of a target that begins at `start` [h, w]: [T, h, w].

        D = start - A phi(-O). A texel takes A, R and O of the source texel at its place, the source
        being repeated over a larger target.
        """
        rows, columns = (np.arange(start.shape[i]) % self.rate.shape[i] for i in (0, 1))
        place = np.ix_(rows, columns)
        amplitude, rate, offset = (m[place] for m in (self.amplitude, self.rate, self.offset))
        base = start - amplitude * self.phi(-offset)
        return np.stack([amplitude * self.phi(rate * t - offset) + base for t in times])


@dataclass(frozen=True)
class STAFModel:
    """A factorised source, and its name.

    parameters: the factors of Kd in red, green and blue, of Ks likewise, and of alpha
    """

    parameters: tuple[Factors, ...]
    name: str

    def synthesize(self, target: TorranceSparrowMaps, times: NDArray[np.floating]) -> Sequence:
        """The target's history at `times` [T], in the source's time, unclamped.

        At t = 0 it is the target. The change added to it is that of the source at the same place,
        whatever the target shows there: how STAF loses spatial consistency.
        """
        clock = np.asarray(times, np.float64)
        starts = (*np.moveaxis(target.kd, -1, 0), *np.moveaxis(target.ks, -1, 0), target.alpha)
        histories = [
            factors.history(start, clock).astype(np.float32)
            for factors, start in zip(self.parameters, starts, strict=True)
        ]
        kd, ks, alpha = np.stack(histories[:3], -1), np.stack(histories[3:6], -1), histories[6]
        return Sequence(kd, ks, alpha, clock.astype(np.float32), None, f"{self.name}_staf")


def fit(source: Sequence) -> STAFModel:
    """The factors of `source`, from its frames as they are.

    phi comes from at most 1,024 texels that change, evenly spaced in row order: alternately A, D, R
    and O of every texel given phi, and phi given them, by least squares in which texels that fit
    badly count less. Then A, R and O of all texels given phi.

    Raises `InputError` for a source with fewer than four frames.
    """
    if len(source.times) < _FACTORS:
        raise InputError(
            f"STAF fits four numbers to a texel's history, and the sequence {source.name} has only"
            f" {len(source.times)} frames.",
            "Give it at least four.",
        )
    times = source.times.astype(np.float64)
    maps = (*np.moveaxis(source.kd, -1, 0), *np.moveaxis(source.ks, -1, 0), source.alpha)
    return STAFModel(tuple(_factors(m, times) for m in maps), source.name)


def _factors(maps: NDArray[np.float32], times: Doubles) -> Factors:
    """The factors of one parameter's maps [T, H, W]."""
    histories = maps.reshape(len(times), -1).T.astype(np.float64)
    change = _centerd(histories)
    moving = np.linalg.norm(change, axis=1) > _STILL * np.linalg.norm(histories, axis=1)
    phi = Chebyshev((0.5, 0.5), (0, 1))
    amplitude, timing = np.zeros(len(change)), np.tile((1.0, 0.0), (len(change), 1))
    if moving.any():
        change = change[moving]
        phi, starts = _curve_and_timings(_spread(change, _MOST_TEXELS), times)
        found = _best_of(_spread(starts, _MOST_STARTS), timing[moving], phi, change, times)
        timing[moving] = _refined(found, phi, change, times, _STEPS)
        amplitude[moving], _ = _projected(phi(_warped(timing[moving], times)), change)
    return Factors(phi, *(m.reshape(maps.shape[1:]) for m in (amplitude, *timing.T)))


def _curve_and_timings(change: Doubles, times: Doubles) -> tuple[Chebyshev, Doubles]:
    """phi, and (R, O) of each texel [N, 2], by alternating least squares.

    `change` [N, T] are histories less their means, none of them constant.
    """
    degree = min(_DEGREE, len(times) - 1)
    size = np.linalg.norm(change, axis=1)
    unit = change / size[:, None]
    _, common = np.linalg.eigh(unit.T @ unit)
    phi = Chebyshev.fit(times, common[:, -1], degree)
    timing = np.tile((1.0, 0.0), (len(change), 1))
    last = np.inf
    for _ in range(_ROUNDS):
        phi, timing = _normalized(phi, timing)
        timing = _best_of(_spread(timing, _MOST_STARTS), timing, phi, change, times)
        timing = _refined(timing, phi, change, times, 3)
        warped = _warped(timing, times)
        amplitude, residual = _projected(phi(warped), change)
        misfit = np.linalg.norm(residual, axis=1)
        usual = max(np.median(misfit), 1e-6 * np.median(size))
        # Beyond the median a texel counts as its misfit does, not as its square (Huber).
        weight = np.sqrt(np.minimum(1, usual / (misfit + _TINY)))
        phi = _curve(warped, amplitude * weight, change * weight[:, None], degree)
        loss = misfit.mean()
        if loss < 1e-5 * size.mean() or abs(loss - last) < 1e-4 * last:
            break
        last = loss
    return _normalized(phi, timing)


def _curve(warped: Doubles, amplitude: Doubles, change: Doubles, degree: int) -> Chebyshev:
    """The phi with least sum of (A phi(t') - mean over t - change)^2, t' = `warped` [N, T]."""
    low, high = warped.min(), warped.max()
    x = (2 * warped - low - high) / (high - low)
    basis = np.polynomial.chebyshev.chebvander(x, degree)[..., 1:]  # all but D's constant
    basis = (basis - basis.mean(1, keepdims=True)) * amplitude[:, None, None]
    coefficients, *_ = np.linalg.lstsq(basis.reshape(-1, degree), change.reshape(-1), rcond=None)
    return Chebyshev((0, *coefficients), (low, high))


def _normalized(phi: Chebyshev, timing: Doubles) -> tuple[Chebyshev, Doubles]:
    """The same factors with median R = 1, median O = 0, phi(0) = 0, and 1 its extreme on [0, 1].

    phi(R t - O) = phi(r t' + o) with t' = (R t - O - o) / r; A and D take up the rest.
    """
    rate, offset = np.median(timing, axis=0)
    phi = Chebyshev(phi.coef, (phi.domain + offset) / rate)
    phi = phi - phi(0.0)
    values = phi(np.linspace(0, 1, 65))
    return phi / values[np.abs(values).argmax()], (timing - (0, offset)) / rate


def _best_of(
    starts: Doubles, timing: Doubles, phi: Chebyshev, change: Doubles, times: Doubles
) -> Doubles:
    """The timings [N, 2], each replaced by the best of `starts` [K, 2] where that fits better."""
    curves = _centerd(phi(_warped(starts, times)))
    curves /= np.linalg.norm(curves, axis=1, keepdims=True) + _TINY
    along = np.abs(change @ curves.T)  # [N, K], how much of the change a curve can take up
    _, residual = _projected(phi(_warped(timing, times)), change)
    better = np.square(along.max(1)) > _dot(change, change) - _dot(residual, residual)
    return np.where(better[:, None], starts[along.argmax(1)], timing)


def _refined(
    timing: Doubles, phi: Chebyshev, change: Doubles, times: Doubles, steps: int
) -> Doubles:
    """(R, O) after some Levenberg-Marquardt steps, A and D being at their best for each R and O.

    Steps that do not help are not taken; where the curve says nothing of R or O they stay.
    """
    slope = phi.deriv()
    damping = np.full(len(change), 1e-3)
    for _ in range(steps):
        warped = _warped(timing, times)
        curve = _centerd(phi(warped))
        amplitude, residual = _projected(curve, change)
        towards = amplitude[:, None] * slope(warped)
        # What A and D can take up of a change of R or O is not R's or O's to explain.
        _, by_rate = _projected(curve, _centerd(towards * times))
        _, by_offset = _projected(curve, _centerd(-towards))
        rr, ro, oo = _dot(by_rate, by_rate), _dot(by_rate, by_offset), _dot(by_offset, by_offset)
        r, o = _dot(by_rate, residual), _dot(by_offset, residual)
        held = damping * (rr + oo) + _TINY
        rr, oo = rr + held, oo + held
        step = np.stack((oo * r - ro * o, rr * o - ro * r), -1) / (rr * oo - ro**2)[:, None]
        tried = np.clip(timing + step, *_BOUNDS)
        _, left = _projected(phi(_warped(tried, times)), change)
        better = _dot(left, left) < _dot(residual, residual)
        timing = np.where(better[:, None], tried, timing)
        damping *= np.where(better, 0.25, 8)
    return timing


def _projected(curve: Doubles, change: Doubles) -> tuple[Doubles, Doubles]:
    """The A that brings a curve nearest to the change, [N], and what is left of it, [N, T]."""
    curve = _centerd(curve)
    amplitude = _dot(curve, change) / (_dot(curve, curve) + _TINY)
    return amplitude, change - amplitude[:, None] * curve


def _warped(timing: Doubles, times: Doubles) -> Doubles:
    """t' = R t - O: [N, T]."""
    return timing[:, :1] * times - timing[:, 1:]


def _dot(a: Doubles, b: Doubles) -> Doubles:
    """The scalar products of the rows of [N, T]: [N]."""
    return (a * b).sum(1)


def _centerd(histories: Doubles) -> Doubles:
    """Histories [N, T] less their means over time, which D takes up."""
    return histories - histories.mean(1, keepdims=True)


def _spread(rows: Doubles, most: int) -> Doubles:
    """At most so many of the rows, evenly spaced."""
    return rows[np.linspace(0, len(rows) - 1, min(most, len(rows))).astype(int)]
