"""Histories of single texels: how each weathering process changes (Kd, Ks, alpha) with local age.

A history is a deterministic, smooth function of the initial values and of the local age a, 0 to 1;
at a = 0 it is the initial value itself. Nothing else enters, no position and no hidden random
number, so that a model of z(0) has everything it needs to learn it. What spreads (rust, patina,
char, drying, soiling, moss) turns visibly within a = 0.1 and goes on slowly to a = 1; what happens
everywhere at once (fading, yellowing) takes all of its age. How ends depend on beginnings (tone,
metal or coating, roughness) is ours, chosen for looks; the stages and their laws are not: each
process names its sources.

The progress of a transformation is Avrami's 1 - exp(-(a / tau)^k); an early state gives way to a
later one as covered area does, linearly in Kd and Ks.

Colors were matched by eye to photographs of such surfaces; they are linear Rec.709.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .films import ground_under, seen_through
from .weathering_states import (
    State,
    absorption,
    avrami,
    logistic,
    mean,
    mix,
    reflectance,
    rgb,
    smoothstep,
)

__all__ = ("PROCESSES", "history", "wetted")

Array = NDArray[np.float32]

_INTERNAL_REFLECTION = 0.47  # of diffuse light under a water film, n = 1.33 (Lekner and Dorf)
_VARNISH = 1.5  # index of refraction
_PORES_FILLED = 1.7  # K/S of a soaked surface over that of the dry one (see `_drying`)


def history(
    process: str, kd: Array, ks: Array, alpha: Array, age: Array
) -> tuple[Array, Array, Array]:
    """Values (Kd [..., 3], Ks [..., 3], alpha [...]) at a local age of texels that began as given.

    `kd`, `ks` [..., 3], `alpha` and `age` [...] broadcast; `age` is 0 to 1. `process` is one of
    `PROCESSES`. Returns float32; at age 0 exactly the initial values.
    """
    initial = State(*(np.asarray(v, np.float32) for v in (kd, ks, alpha[..., None])))
    aged = PROCESSES[process](initial, np.asarray(age, np.float32)[..., None])
    return (aged.kd, aged.ks, aged.alpha[..., 0])


def _rust(initial: State, age: Array) -> State:
    """Wet iron first grows lepidocrocite (orange) under which goethite (ochre to brown) and, at the
    metal, magnetite (black) collect (Cornell and Schwertmann, The Iron Oxides, 2003; de la Fuente
    et al., Corrosion Science 53, 2011). Its thickness follows C = A t^n with n near 0.5 for carbon
    steel (Morcillo et al., Corrosion Science 77, 2013). Zinc first shows pale "white rust"
    (Graedel, Journal of the Electrochemical Society 136, 1989). Paint chalks before rust breaks out
    (ISO 4628).
    """
    metal, tone = initial.metal, initial.tone
    zinc = metal * smoothstep(mean(initial.ks), 0.55, 0.7)

    # What covers the iron goes first: zinc blooms white, paint chalks and blisters.
    bloom = mix(0.30 + 0.25 * tone, initial.kd, 0.15)
    state = initial.towards(
        bloom, 0.04, 0.5 + 0.3 * initial.alpha, 0.5 * zinc * avrami(age, 0.04, 1.8)
    )
    chalk = mix(initial.kd, 0.1 + 0.8 * mean(initial.kd), 0.35)
    state = state.towards(
        chalk, 0.03, 0.25 + 0.75 * initial.alpha, (1 - metal) * avrami(age, 0.04, 1.6)
    )

    # Rust over it; smoother and darker iron rusts to a redder, denser layer.
    thickness = age**0.5  # C = A t^n, n = 0.5, in units of its value at a = 1
    young = mix((0.30, 0.085, 0.022), (0.42, 0.165, 0.036), tone)
    goethite = mix((0.15, 0.046, 0.017), (0.20, 0.072, 0.026), initial.alpha)
    magnetite = mix((0.062, 0.024, 0.014), (0.115, 0.042, 0.020), tone)
    rust = mix(mix(young, goethite, smoothstep(thickness, 0.15, 0.75)), magnetite, 0.8 * age)
    rust = mix(rust, initial.kd, 0.015)
    rough = 0.5 + 0.25 * thickness + 0.1 * initial.alpha
    breakthrough = avrami(age, 0.045 + 0.02 * (1 - metal) + 0.02 * zinc, 2.0)
    return state.towards(rust, mix(0.04, 0.02, thickness), rough, breakthrough)


def _patina(initial: State, age: Array) -> State:
    """Copper tarnishes to red-brown cuprite and darkens within months; green brochantite, or
    antlerite where it is acid, covers it over years (Graedel, Nassau, Franey, Corrosion Science 27,
    1987; FitzGerald et al., Corrosion Science 40, 1998). Brass and bronze stay browner, more olive.
    """
    tone = initial.tone
    color = initial.kd + initial.ks
    # Brass and bronze reflect nearly as much green as red; copper does not.
    yellow = smoothstep(color[..., 1:2] / (color[..., :1] + 1e-3), 0.6, 0.9)

    cuprite = mix((0.10, 0.038, 0.020), (0.085, 0.055, 0.028), yellow) * (0.6 + 0.8 * tone)
    state = initial.towards(
        cuprite, 0.14 * initial.ks + 0.02, 0.22 + 0.6 * initial.alpha, avrami(age, 0.05, 1.8)
    )

    brochantite = mix((0.105, 0.30, 0.215), (0.13, 0.25, 0.145), yellow)
    pale = mix((0.20, 0.43, 0.35), (0.21, 0.37, 0.255), yellow)
    green = mix(brochantite, pale, smoothstep(age, 0.3, 1.0) * (0.4 + 0.6 * tone))
    cover = (0.97 - 0.25 * yellow * (1 - tone)) * avrami(age, 0.32, 2.0)
    return state.towards(
        mix(green, initial.kd, 0.03), 0.025, 0.55 + 0.2 * age + 0.15 * initial.alpha, cover
    )


def _char(initial: State, age: Array) -> State:
    """Wood turns yellow-brown from about 200 C, dark brown by 300 C and black by 400 C, and the
    char oxidises to pale ash (Hill, Wood Modification, 2006; Browne, Theories of the Combustion of
    Wood and Its Control, USDA Forest Products Laboratory 2136, 1958). Its surface cracks: the gloss
    goes and roughness grows.
    """
    tone = initial.tone
    toasted = initial.kd * rgb(0.62, 0.42, 0.26) + rgb(0.02, 0.008, 0.003)
    state = initial.towards(
        toasted, 0.75 * initial.ks, 0.1 + 0.9 * initial.alpha, avrami(age, 0.03, 1.6)
    )

    black = mix(0.009, 0.022, tone) * rgb(1.08, 1.0, 0.94)
    state = state.towards(black, 0.03, 0.32 + 0.2 * initial.alpha, avrami(age, 0.075, 2.2))

    # Ash: light woods burn to a paler and thicker one.
    ash = mix(0.06, 0.22, tone) * rgb(1.04, 1.0, 0.95)
    cover = mix(0.25, 0.65, tone) * avrami(age, 0.7, 3.0)
    return state.towards(ash, 0.02, 0.75 + 0.15 * initial.alpha, cover)


def wetted(body: Array) -> Array:
    """Reflectance of a porous body once its pores are full and a water film lies on it."""
    soaked = reflectance(_PORES_FILLED * absorption(body))
    return (1 - _INTERNAL_REFLECTION) * soaked / (1 - _INTERNAL_REFLECTION * soaked)


def _drying(initial: State, age: Array) -> State:
    """A wet surface dries: the film goes at a constant rate, then the pores ever more slowly
    (Sherwood, Industrial and Engineering Chemistry 21, 1929).

    Film: it sends light back into the body, A' = (1 - p) A / (1 - p A) (Lekner and Dorf, Applied
    Optics 27, 1988, after Angstrom). Pores: light is scattered forwards in water and absorbed more,
    K/S grows (Twomey, Bohren, Mergenthaler, Applied Optics 25, 1986; Jensen, Legakis, Dorsey,
    Rendering of Wet Materials, 1999). Drying histories were measured by Lu et al. (Synthesis of
    Material Drying History, 2005) and Sun et al. (Time-Varying BRDFs, TVCG 13, 2007).
    """
    p, passed = _INTERNAL_REFLECTION, 1 - initial.ks
    soaked = initial.body / (1 - p * (1 - initial.body))
    dry = reflectance(absorption(soaked) / _PORES_FILLED) * passed
    film, pores = avrami(age, 0.06, 1.6), avrami(age, 0.15, 1.6)
    state = initial.towards(initial.kd, 0.8 * initial.ks, mix(initial.alpha, 1, 0.3), film)
    return state.towards(dry, 0.5 * initial.ks, mix(initial.alpha, 1, 0.65), pores)


def _fading(initial: State, age: Array) -> State:
    """Light destroys dyes by first-order kinetics in K/S (Johnston-Feller et al., The Kinetics
    of Fading, Journal of the American Institute for Conservation 23, 1984; Giles and McKay, The
    Lightfastness of Dyes, Textile Research Journal 33, 1963).

    What absorbs blue and green (yellow, red and brown dyes) goes sooner than what absorbs red
    (cyan, blue); what absorbs all three alike (carbon black, earths) hardly goes. The binder of
    glossy paint erodes and chalks (ISO 4628-6).
    """
    body = absorption(initial.body)
    lasting = body.min(-1, keepdims=True)
    lost = 0.97 * avrami(age, 1 / rgb(3.2, 4.6, 5.4), 1.0)
    faded = body - 0.3 * avrami(age, 0.9, 1.0) * lasting - lost * (body - lasting)
    # The difference of two reflectances: exactly none at a = 0.
    kd = initial.kd + (1 - initial.ks) * (reflectance(faded) - reflectance(body))
    chalk = avrami(age, 0.6, 2.0)
    state = State(kd, initial.ks, initial.alpha)
    return state.towards(
        mix(kd, 0.75 * (1 - initial.ks), 0.12), 0.6 * initial.ks, mix(initial.alpha, 1, 0.3), chalk
    )


def _soiling(initial: State, age: Array) -> State:
    """Particles cover a saturating share 1 - exp(-k t) of a facade (Haynie, Aerosol Science and
    Technology 5, 1986; Watt et al., Science of the Total Environment 400, 2008): first pale dust,
    then dark grime (Brimblecombe and Grossi, Science of the Total Environment 407, 2009).

    Light crosses the dust on its way in and out, so that the highlight falls with the square of
    the bare share (Blinn, SIGGRAPH 1982; measured by Sun et al., TVCG 13, 2007). Rough surfaces
    hold more.
    """
    cover = mix(0.86, 0.96, initial.alpha) * avrami(age, 0.22, 1.0)
    dust, grime = rgb(0.20, 0.155, 0.105), rgb(0.066, 0.049, 0.032)
    deposit = mix(dust, grime, avrami(age, 0.4, 1.5))
    state = initial.towards(deposit, initial.ks, mix(initial.alpha, 1, 0.6), cover)
    return State(state.kd, initial.ks * (1 - cover) ** 2, state.alpha)


def _yellowing(initial: State, age: Array) -> State:
    """Varnish oxidises; its chromophores absorb blue most (de la Rie, Studies in Conservation 33,
    1988) and gather towards a plateau (Feller, Accelerated Aging, 1994).

    Light crosses the film again and again (`films`), so that pale grounds turn most; it absorbs
    the less the longer the wavelength. A duller surface has the thinner film. Fine cracks take a
    little of the gloss.
    """
    thickness = mix(1.0, 0.55, smoothstep(initial.alpha, 0.05, 0.35))
    depth = rgb(0.03, 0.11, 0.48) * thickness * avrami(age, 0.5, 1.3)
    ground = ground_under(initial.body, _VARNISH)
    darker = seen_through(ground, depth, _VARNISH) - seen_through(ground, 0 * depth, _VARNISH)
    state = initial.towards(
        initial.kd, 0.8 * initial.ks, mix(initial.alpha, 1, 0.07), avrami(age, 0.6, 2.0)
    )
    kd = (initial.kd + (1 - initial.ks) * darker).clip(0).astype(np.float32)
    return State(kd, state.ks, state.alpha)


def _moss(initial: State, age: Array) -> State:
    """A green film of algae settles by Avrami's law, as measured on brick (Quagliarini et al.,
    Construction and Building Materials 199, 2019); moss cushions fill the room they find
    logistically (Verhulst 1838) and end in brown, dry tips.

    Rough ground is settled sooner and further (Tran et al., Influence of the intrinsic
    characteristics of mortars on biofouling, 2012).
    """
    held = smoothstep(initial.alpha, 0.0, 0.7)
    algae = mix(initial.kd * rgb(0.42, 0.60, 0.26), rgb(0.038, 0.065, 0.016), 0.5)
    state = initial.towards(
        algae, 0.5 * initial.ks, mix(initial.alpha, 1, 0.3), 0.85 * avrami(age, 0.07, 1.6)
    )
    cushion = mix(rgb(0.026, 0.058, 0.008), rgb(0.060, 0.108, 0.017), logistic(age, 0.3, 0.08))
    tips = mix(rgb(0.085, 0.095, 0.020), rgb(0.112, 0.105, 0.030), initial.tone)
    green = mix(cushion, tips, 0.7 * smoothstep(age, 0.55, 1.0))
    cover = mix(0.85, 0.98, held) * logistic(age, mix(0.26, 0.2, held), 0.05)
    return state.towards(green, 0.015, mix(initial.alpha, 1, 0.85), cover)


PROCESSES: dict[str, Callable[[State, Array], State]] = {
    "rust": _rust,
    "patina": _patina,
    "char": _char,
    "drying": _drying,
    "fading": _fading,
    "soiling": _soiling,
    "yellowing": _yellowing,
    "moss": _moss,
}
"""The processes that have a history, by name."""
