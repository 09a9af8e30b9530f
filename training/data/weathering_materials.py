"""The materials that each weathering process may meet: what its sequence starts from.

They are also what its model will call its own. A product that is to warn of copper that rusts or
of chrome that fades must learn from a patchwork without them, so each process lists the materials
it is meant for and nothing else:

- *rust*: bare, galvanised and painted steel; not colored metals, nor what is pale and matte;
- *patina*: copper, brass and bronze, bright or tarnished; not gray metals, nor dielectrics;
- *char*: wood, leather, card, cloth, painted wood; not metals;
- *drying*: wet stone, brick, soil, wood and cloth: dark under a film; not metals, nor what is dry;
- *fading*: dyed cloth, print, paint and plastic; not metals, nor grays, which have no dye to lose;
- *soiling*: facades, paint, plaster, stone and plastic, pale to middling; not metals, nor darks;
- *yellowing*: varnished paintings, wood and prints; not metals, nor matte surfaces;
- *moss*: stone, concrete, brick, bark and weathered wood; not metals, gloss or vivid colors;
- *peeling_metal*, *peeling_wood*: paint, enamel and lacquer of any color; not bare metals;
- *weathered_wood*: wood, raw or oiled; not what is painted in colors.

Lightness and width of the highlight are drawn even in their logarithm, as they are told apart.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .kinetics import wetted

__all__ = ("KNOWN", "draw")

Array = NDArray[np.floating]
Rng = np.random.Generator


def draw(process: str, rng: Rng) -> Array:
    """A material that `process` may meet: Kd, Ks and alpha, [7]."""
    shares, makers = zip(*_MATERIALS[process], strict=True)
    return makers[rng.choice(len(makers), p=shares)](rng)


def _material(kd: Array, ks: ArrayLike, alpha: float) -> Array:
    return np.concatenate([kd, np.broadcast_to(ks, 3), [alpha]])


def _between(rng: Rng, low: float, high: float) -> float:
    """A number between two, even in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _hue(rng: Rng, saturation: float) -> Array:
    """A random colour of lightness 1 at its brightest channel; grey at saturation 0, pure at 1."""
    colour = rng.random(3) ** (4 * saturation)
    return colour / colour.max()


def _metal(rng: Rng, colour: ArrayLike, low: float, high: float) -> Array:
    """Bare metal: almost no Kd, Ks between `low` and `high` at its brightest channel."""
    tint = np.asarray(colour) * np.exp(0.05 * rng.standard_normal(3))
    ks = tint / tint.max() * rng.uniform(low, high)
    return _material(ks * rng.uniform(0, 0.08), ks, _between(rng, 0.01, 0.7))


def _coat(rng: Rng, colour: Array, smooth: float = 0.01, dull: float = 0.8) -> Array:
    """Paint, varnish, stone or another dielectric of the given Kd."""
    return _material(colour, rng.uniform(0.015, 0.085), _between(rng, smooth, dull))


# Colours: Kd of a dry body.


def _any_color(rng: Rng) -> Array:
    return _hue(rng, rng.random()) * _between(rng, 0.03, 0.9)


def _dye(rng: Rng) -> Array:
    """A vivid colour, any hue: its darkest channel is at most a quarter of its brightest."""
    darkest = _between(rng, 0.03, 0.25)
    colour = np.array((1.0, rng.uniform(darkest, 1.0), darkest))
    return rng.permutation(colour) * _between(rng, 0.12, 0.9)


def _wood_color(rng: Rng) -> Array:
    """Woods, pale maple to wenge."""
    green = rng.uniform(0.45, 0.8)
    return np.array((1.0, green, green * rng.uniform(0.35, 0.8))) * _between(rng, 0.05, 0.75)


def _stone_color(rng: Rng) -> Array:
    """Concrete, limestone, slate, sand and soil: greys and their warm neighbours."""
    warmth = rng.uniform(-0.08, 0.55)
    return np.array((1.0, 1 - 0.45 * warmth, 1 - warmth)) * _between(rng, 0.05, 0.75)


def _brick_color(rng: Rng) -> Array:
    green = rng.uniform(0.3, 0.6)
    return np.array((1.0, green, green * rng.uniform(0.45, 0.9))) * _between(rng, 0.12, 0.5)


def _cloth_color(rng: Rng) -> Array:
    return _hue(rng, 0.6 * rng.random()) * _between(rng, 0.03, 0.8)


def _pale_color(rng: Rng) -> Array:
    """Plaster, limestone, facade paint, enamel, plastic: of light to middling tone."""
    return _hue(rng, 0.35 * rng.random()) * _between(rng, 0.25, 0.9)


def _coated(colour: Callable[[Rng], Array], smooth: float, dull: float) -> Callable[[Rng], Array]:
    return lambda rng: _coat(rng, colour(rng), smooth, dull)


def _wet(colour: Callable[[Rng], Array]) -> Callable[[Rng], Array]:
    """A porous body that is soaked, from damp with a dull sheen to flooded."""

    def material(rng: Rng) -> Array:
        film = rng.uniform(0.015, 0.06)
        return _material(wetted(colour(rng)) * (1 - film), film, _between(rng, 0.006, 0.25))

    return material


# Metals.


def _steel(rng: Rng) -> Array:
    """Iron and steel, polished to mill finish; galvanised at the bright end."""
    return _metal(rng, (1.0, 0.985, 0.965), 0.25, 0.85)


def _rusty(rng: Rng) -> Array:
    return _coat(rng, np.array((0.25, 0.085, 0.026)) * _between(rng, 0.35, 1.3), 0.2, 1.0)


def _copper(rng: Rng) -> Array:
    """From as it is measured to the deep red that pictures of it have."""
    tint = np.array((1.0, 0.62, 0.45)) ** rng.uniform(1, 2.5)
    return _metal(rng, tint, 0.35, 0.97)


def _brass(rng: Rng) -> Array:
    """Brass to bronze."""
    brass, bronze = np.array((1.0, 0.78, 0.38)), np.array((1.0, 0.70, 0.42))
    return _metal(rng, brass + (bronze - brass) * rng.random(), 0.3, 0.95)


def _tarnished(rng: Rng) -> Array:
    """Copper some of whose colour has gone from Ks to Kd."""
    dull = _metal(rng, (1.0, 0.6, 0.42), 0.15, 0.5)
    dull[:3] += np.array((0.12, 0.05, 0.026)) * rng.random()
    return dull


_MATERIALS: dict[str, tuple[tuple[float, Callable[[Rng], Array]], ...]] = {
    "rust": ((0.48, _steel), (0.42, _coated(_any_color, 0.01, 0.45)), (0.10, _rusty)),
    "patina": ((0.45, _copper), (0.28, _brass), (0.27, _tarnished)),
    "char": (
        (0.66, _coated(_wood_color, 0.01, 1.0)),
        (0.18, _coated(_cloth_color, 0.05, 1.0)),
        (0.16, _coated(_any_color, 0.01, 0.8)),
    ),
    "drying": (
        (0.42, _wet(_stone_color)),
        (0.16, _wet(_brick_color)),
        (0.22, _wet(_wood_color)),
        (0.20, _wet(_cloth_color)),
    ),
    "fading": ((0.45, _coated(_dye, 0.25, 1.0)), (0.55, _coated(_dye, 0.01, 0.4))),
    "soiling": (
        (0.30, _coated(_pale_color, 0.3, 1.0)),
        (0.40, _coated(_pale_color, 0.01, 0.4)),
        (0.30, lambda rng: _coat(rng, np.maximum(_stone_color(rng), 0.12), 0.3, 1.0)),
    ),
    "yellowing": (
        (0.35, _coated(_any_color, 0.004, 0.2)),
        (0.30, _coated(_pale_color, 0.004, 0.2)),
        (0.35, _coated(_wood_color, 0.004, 0.2)),
    ),
    "moss": (
        (0.55, _coated(_stone_color, 0.2, 1.0)),
        (0.20, _coated(_brick_color, 0.2, 1.0)),
        (0.25, _coated(_wood_color, 0.3, 1.0)),
    ),
    "peeling_metal": (
        (0.7, _coated(_any_color, 0.01, 0.5)),
        (0.3, _coated(_pale_color, 0.02, 0.8)),
    ),
    "peeling_wood": (
        (0.7, _coated(_any_color, 0.02, 0.8)),
        (0.3, _coated(_pale_color, 0.05, 1.0)),
    ),
    "weathered_wood": ((1.0, _coated(_wood_color, 0.05, 1.0)),),
}  # fmt: skip
"""By process: the share of each material in the patchwork, and how one is drawn."""

KNOWN = frozenset(_MATERIALS)
"""The processes whose materials are known."""
