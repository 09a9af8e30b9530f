"""Histories of single texels: how rust, patina and char change (Kd, Ks, alpha) with local age.

A history is a deterministic, smooth function of the initial values and of the local age a, 0 to 1;
at a = 0 it is the initial value itself. Nothing else enters, no position and no hidden random
number, so that a model of z(0) has everything it needs to learn it. Each turns visibly within
a = 0.06 to 0.1 (two to three frames of 36) and goes on slowly to a = 1. How ends depend on
beginnings (tone, metal or coating, roughness) is ours, chosen for looks; the stages are not.

The progress of a transformation is Avrami's 1 - exp(-(a / tau)^k); an early state gives way to a
later one as covered area does, linearly in Kd and Ks.

Rust. Wet iron first grows lepidocrocite (orange) under which goethite (ochre to brown) and, at the
metal, magnetite (black) collect (Cornell and Schwertmann, The Iron Oxides, 2003; de la Fuente et
al., Corrosion Science 53, 2011). Its thickness follows C = A t^n with n near 0.5 for carbon steel
(Morcillo et al., Corrosion Science 77, 2013). Zinc first shows pale "white rust" (Graedel, Journal
of the Electrochemical Society 136, 1989). Paint chalks before rust breaks out (ISO 4628).

Patina. Copper tarnishes to red-brown cuprite and darkens within months; green brochantite, or
antlerite where it is acid, covers it over years (Graedel, Nassau, Franey, Corrosion Science 27,
1987; FitzGerald et al., Corrosion Science 40, 1998). Brass and bronze stay browner and more olive.

Char. Wood turns yellow-brown from about 200 C, dark brown by 300 C and black by 400 C, and the
char oxidises to pale ash (Hill, Wood Modification, 2006; Browne, Theories of the Combustion of Wood
and Its Control, USDA Forest Products Laboratory 2136, 1958). Its surface cracks: the gloss goes and
roughness grows.

Colours were matched by eye to photographs of such surfaces; they are linear Rec.709.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ("PROCESSES", "history")

Array = NDArray[np.float32]


@dataclass(frozen=True)
class _State:
    """Torrance-Sparrow values of texels: kd, ks [..., 3]; alpha [..., 1]."""

    kd: Array
    ks: Array
    alpha: Array

    def towards(self, kd: ArrayLike, ks: ArrayLike, alpha: ArrayLike, share: Array) -> _State:
        """This state with `share` of it replaced by another."""
        return _State(
            _mix(self.kd, kd, share), _mix(self.ks, ks, share), _mix(self.alpha, alpha, share)
        )


def history(
    process: str, kd: Array, ks: Array, alpha: Array, age: Array
) -> tuple[Array, Array, Array]:
    """Values (Kd [..., 3], Ks [..., 3], alpha [...]) at a local age of texels that began as given.

    `kd`, `ks` [..., 3], `alpha` and `age` [...] broadcast; `age` is 0 to 1. `process` is one of
    `PROCESSES`. Returns float32; at age 0 exactly the initial values.
    """
    initial = _State(*(np.asarray(v, np.float32) for v in (kd, ks, alpha[..., None])))
    aged = PROCESSES[process](initial, np.asarray(age, np.float32)[..., None])
    return (aged.kd, aged.ks, aged.alpha[..., 0])


def _rust(initial: _State, age: Array) -> _State:
    metal, tone = _metal(initial), _tone(initial)
    zinc = metal * _smoothstep(_mean(initial.ks), 0.55, 0.7)

    # What covers the iron goes first: zinc blooms white, paint chalks and blisters.
    bloom = _mix(0.30 + 0.25 * tone, initial.kd, 0.15)
    state = initial.towards(
        bloom, 0.04, 0.5 + 0.3 * initial.alpha, 0.5 * zinc * _avrami(age, 0.04, 1.8)
    )
    chalk = _mix(initial.kd, 0.1 + 0.8 * _mean(initial.kd), 0.35)
    state = state.towards(
        chalk, 0.03, 0.25 + 0.75 * initial.alpha, (1 - metal) * _avrami(age, 0.04, 1.6)
    )

    # Rust over it; smoother and darker iron rusts to a redder, denser layer.
    thickness = age**0.5  # C = A t^n, n = 0.5, in units of its value at a = 1
    young = _mix((0.30, 0.085, 0.022), (0.42, 0.165, 0.036), tone)
    goethite = _mix((0.15, 0.046, 0.017), (0.20, 0.072, 0.026), initial.alpha)
    magnetite = _mix((0.062, 0.024, 0.014), (0.115, 0.042, 0.020), tone)
    rust = _mix(_mix(young, goethite, _smoothstep(thickness, 0.15, 0.75)), magnetite, 0.8 * age)
    rust = _mix(rust, initial.kd, 0.015)
    rough = 0.5 + 0.25 * thickness + 0.1 * initial.alpha
    breakthrough = _avrami(age, 0.045 + 0.02 * (1 - metal) + 0.02 * zinc, 2.0)
    return state.towards(rust, _mix(0.04, 0.02, thickness), rough, breakthrough)


def _patina(initial: _State, age: Array) -> _State:
    tone = _tone(initial)
    colour = initial.kd + initial.ks
    # Brass and bronze reflect nearly as much green as red; copper does not.
    yellow = _smoothstep(colour[..., 1:2] / (colour[..., :1] + 1e-3), 0.6, 0.9)

    cuprite = _mix((0.10, 0.038, 0.020), (0.085, 0.055, 0.028), yellow) * (0.6 + 0.8 * tone)
    state = initial.towards(
        cuprite, 0.14 * initial.ks + 0.02, 0.22 + 0.6 * initial.alpha, _avrami(age, 0.05, 1.8)
    )

    brochantite = _mix((0.105, 0.30, 0.215), (0.13, 0.25, 0.145), yellow)
    pale = _mix((0.20, 0.43, 0.35), (0.21, 0.37, 0.255), yellow)
    green = _mix(brochantite, pale, _smoothstep(age, 0.3, 1.0) * (0.4 + 0.6 * tone))
    cover = (0.97 - 0.25 * yellow * (1 - tone)) * _avrami(age, 0.32, 2.0)
    return state.towards(
        _mix(green, initial.kd, 0.03), 0.025, 0.55 + 0.2 * age + 0.15 * initial.alpha, cover
    )


def _char(initial: _State, age: Array) -> _State:
    tone = _tone(initial)
    toasted = initial.kd * _rgb(0.62, 0.42, 0.26) + _rgb(0.02, 0.008, 0.003)
    state = initial.towards(
        toasted, 0.75 * initial.ks, 0.1 + 0.9 * initial.alpha, _avrami(age, 0.03, 1.6)
    )

    black = _mix(0.009, 0.022, tone) * _rgb(1.08, 1.0, 0.94)
    state = state.towards(black, 0.03, 0.32 + 0.2 * initial.alpha, _avrami(age, 0.075, 2.2))

    # Ash: light woods burn to a paler and thicker one.
    ash = _mix(0.06, 0.22, tone) * _rgb(1.04, 1.0, 0.95)
    cover = _mix(0.25, 0.65, tone) * _avrami(age, 0.7, 3.0)
    return state.towards(ash, 0.02, 0.75 + 0.15 * initial.alpha, cover)


PROCESSES: dict[str, Callable[[_State, Array], _State]] = {
    "rust": _rust,
    "patina": _patina,
    "char": _char,
}
"""The processes that have a history, by name."""


def _avrami(age: Array, tau: ArrayLike, k: float) -> Array:
    """Transformed share 1 - exp(-(a / tau)^k) (Avrami 1939)."""
    share = 1 - np.exp(-((age / np.asarray(tau, np.float32)) ** np.float32(k)))
    return np.asarray(share, np.float32)


def _mix(first: ArrayLike, second: ArrayLike, share: ArrayLike) -> Array:
    a, b, s = (np.asarray(v, np.float32) for v in (first, second, share))
    return np.asarray(a + (b - a) * s, np.float32)


def _rgb(*values: float) -> Array:
    return np.array(values, np.float32)


def _smoothstep(x: Array, low: float, high: float) -> Array:
    u = np.clip((x - np.float32(low)) / np.float32(high - low), 0, 1)
    return u * u * (3 - 2 * u)


def _mean(rgb: Array) -> Array:
    return rgb.mean(-1, keepdims=True)


def _tone(state: _State) -> Array:
    """Lightness of the initial material, 0 to 1."""
    return np.sqrt(np.clip(_mean(state.kd + state.ks), 0, 1))


def _metal(state: _State) -> Array:
    """How bare the metal is: 0 for paint and wood (Ks about 0.04), 1 for metals."""
    return _smoothstep(_mean(state.ks), 0.12, 0.35)
