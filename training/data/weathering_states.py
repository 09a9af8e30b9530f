"""States of texels under way, and the curves and optics that weathering histories share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = (
    "State",
    "absorption",
    "avrami",
    "logistic",
    "mean",
    "mix",
    "reflectance",
    "rgb",
    "smoothstep",
)

Array = NDArray[np.float32]


@dataclass(frozen=True)
class State:
    """Torrance-Sparrow values of texels: kd, ks [..., 3]; alpha [..., 1]."""

    kd: Array
    ks: Array
    alpha: Array

    def towards(self, kd: ArrayLike, ks: ArrayLike, alpha: ArrayLike, share: Array) -> State:
        """This state with `share` of it replaced by another."""
        return State(
            mix(self.kd, kd, share), mix(self.ks, ks, share), mix(self.alpha, alpha, share)
        )

    @property
    def tone(self) -> Array:
        """Lightness, 0 to 1."""
        return np.sqrt(np.clip(mean(self.kd + self.ks), 0, 1))

    @property
    def metal(self) -> Array:
        """How bare the metal is: 0 for paint and wood (Ks about 0.04), 1 for metals."""
        return smoothstep(mean(self.ks), 0.12, 0.35)

    @property
    def body(self) -> Array:
        """Reflectance of what lies under the surface, which lets 1 - Ks through."""
        return np.clip(self.kd / np.maximum(1 - self.ks, 0.02), 0, 1)


def avrami(age: Array, tau: ArrayLike, k: float) -> Array:
    """Transformed share 1 - exp(-(a / tau)^k) (Avrami 1939); k = 1 is first-order kinetics."""
    share = 1 - np.exp(-((age / np.asarray(tau, np.float32)) ** np.float32(k)))
    return np.asarray(share, np.float32)


def logistic(age: Array, middle: ArrayLike, width: ArrayLike) -> Array:
    """Share of its room that a population fills (Verhulst 1838), from 0 at a = 0 towards 1."""
    m, w = np.asarray(middle, np.float32), np.asarray(width, np.float32)
    seed = 1 / (1 + np.exp(m / w))
    return np.asarray((1 / (1 + np.exp((m - age) / w)) - seed) / (1 - seed), np.float32)


def absorption(body: Array) -> Array:
    """K/S of an opaque layer of the given reflectance (Kubelka and Munk 1931)."""
    body = np.clip(body, 1e-3, 1)
    return (1 - body) ** 2 / (2 * body)


def reflectance(k_over_s: Array) -> Array:
    """Reflectance of an opaque layer, the inverse of `absorption`."""
    return 1 / (1 + k_over_s + np.sqrt(k_over_s * (k_over_s + 2)))


def mix(first: ArrayLike, second: ArrayLike, share: ArrayLike) -> Array:
    a, b, s = (np.asarray(v, np.float32) for v in (first, second, share))
    return np.asarray(a + (b - a) * s, np.float32)


def smoothstep(x: Array, low: float, high: float) -> Array:
    u = np.clip((x - np.float32(low)) / np.float32(high - low), 0, 1)
    return u * u * (3 - 2 * u)


def mean(color: Array) -> Array:
    return color.mean(-1, keepdims=True)


def rgb(*values: float) -> Array:
    return np.array(values, np.float32)
