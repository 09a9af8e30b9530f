"""How well models suit a material, told by what it looks like and by the words it is called.

Of a material the colors, metallic, roughness and fibers say what it may be made of; a name is a
hint that rules most of that out.  Each process is for some of these substances.  Standard library
only: panels ask while they are drawn.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from .card import ModelCard

__all__ = ("DOUBTFUL", "PURPOSES", "Suited", "Surface", "ordered", "substances")

DOUBTFUL = 0.3
"""What scores less is not made for the material."""


@dataclass(frozen=True)
class Surface:
    """What is known of a material: mean linear `color`, `metallic` and `roughness`, 0 to 1;
    whether it is `textured`, and `fibers`, how many times as much its color changes across as along
    them; its `names`.
    """

    color: tuple[float, float, float]
    metallic: float = 0.0
    roughness: float = 0.5
    textured: bool = False
    fibers: float = 1.0
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Suited:
    """A model by name, its `score` from 0 to 1, and `doubt`: a sentence where it is not for this
    material, else nothing.
    """

    name: str
    score: float
    doubt: str


STEEL, COPPER, OTHER = "steel", "copper", "something else"
PAINTED_METAL, PAINTED_WOOD, PAINT = "painted metal", "painted wood", "paint"
WOOD, STONE, CONCRETE = "wood", "stone", "concrete or plaster"
CLOTH, LEATHER, PLASTIC = "cloth or paper", "leather", "plastic"


@dataclass(frozen=True)
class _Purpose:
    """What a process is `told` to be for, how well it is for each of these `substances`, and
    whether colors, a pale surface or gloss are what it works on.
    """

    told: str
    substances: Mapping[str, float]
    colored: bool = False
    pale: bool = False
    glossy: bool = False


PURPOSES = {
    "rust": _Purpose("Bare or painted steel", {STEEL: 1, PAINTED_METAL: 0.7, PAINT: 0.3}),
    "patina": _Purpose("Copper, brass and bronze", {COPPER: 1}),
    "peeling_metal": _Purpose("Paint on metal", {PAINTED_METAL: 1, PAINT: 0.8}),
    "peeling_wood": _Purpose("Paint on wood", {PAINTED_WOOD: 1, PAINT: 0.6}),
    "weathered_wood": _Purpose("Bare wood outdoors", {WOOD: 1, PAINTED_WOOD: 0.3}),
    "moss": _Purpose("Stone, concrete and old wood", {STONE: 1, CONCRETE: 0.7, WOOD: 0.4}),
    "soiling": _Purpose(
        "Pale walls, stone, paint and plastic",
        {CONCRETE: 1, STONE: 0.8, PLASTIC: 0.7, PAINT: 0.6, PAINTED_METAL: 0.4, CLOTH: 0.4},
        pale=True,
    ),
    "fading": _Purpose(
        "Colored cloth, print, paint and plastic",
        {CLOTH: 1, PLASTIC: 1, PAINT: 0.7, LEATHER: 0.6, PAINTED_METAL: 0.4, PAINTED_WOOD: 0.4},
        colored=True,
    ),
    "yellowing": _Purpose(
        "Varnished wood, paintings and prints", {WOOD: 0.6, PAINT: 0.4, CLOTH: 0.3}, glossy=True
    ),
    "drying": _Purpose(
        "Wet stone, brick, wood and cloth",
        {STONE: 0.7, CONCRETE: 0.7, WOOD: 0.4, CLOTH: 0.4},
        glossy=True,
    ),
    "char": _Purpose("Wood, leather, card and cloth", {LEATHER: 0.9, WOOD: 0.7, CLOTH: 0.6}),
}
"""What each process is for."""

_METALS = (STEEL, COPPER, PAINTED_METAL)
_PAINTS = (PAINT, PAINTED_METAL, PAINTED_WOOD, CONCRETE)  # a wall's paint is not what peels
_WOODS = (WOOD, PAINTED_WOOD)
_WORDS = {
    **dict.fromkeys(("copper", "brass", "bronze"), (COPPER,)),
    **dict.fromkeys(("steel", "iron", "rust", "rusty", "rusted", "tin"), (STEEL, PAINTED_METAL)),
    **dict.fromkeys(("galvanized", "corrugated", "car", "vehicle"), (STEEL, PAINTED_METAL)),
    "metal": _METALS,
    **dict.fromkeys(("paint", "painted", "lacquer", "enamel", "coated"), _PAINTS),
    **dict.fromkeys(("wood", "wooden", "plank", "board", "timber", "parquet", "bark"), _WOODS),
    **dict.fromkeys(("oak", "pine", "walnut", "maple", "cherry", "birch", "fruitwood"), _WOODS),
    **dict.fromkeys(("stone", "rock", "granite", "marble", "slate", "sandstone"), (STONE,)),
    **dict.fromkeys(("gravel", "cobble", "cliff", "limestone"), (STONE,)),
    **dict.fromkeys(("concrete", "plaster", "stucco", "cement", "brick"), (CONCRETE,)),
    **dict.fromkeys(("wall", "facade", "tile", "asphalt"), (CONCRETE, STONE)),
    **dict.fromkeys(("fabric", "cloth", "felt", "cotton", "linen", "wool", "canvas"), (CLOTH,)),
    **dict.fromkeys(("terrazzo", "travertine", "onyx", "paving"), (STONE,)),
    **dict.fromkeys(("floor", "ground", "fence", "siding"), (*_WOODS, *_METALS, STONE, CONCRETE)),
    **dict.fromkeys(("clay", "terracotta", "road"), (CONCRETE,)),
    **dict.fromkeys(("roof", "roofing"), (*_METALS, CONCRETE, STONE)),
    **dict.fromkeys(("sheet", "plate", "pipe", "rail"), _METALS),
    **dict.fromkeys(("wallpaper", "wicker", "rope", "tape"), (CLOTH,)),
    **dict.fromkeys(("paper", "card", "cardboard", "carpet", "denim", "curtain"), (CLOTH,)),
    "leather": (LEATHER,),
    **dict.fromkeys(("plastic", "acrylic", "vinyl", "pvc", "polymer", "nylon"), (PLASTIC,)),
    **dict.fromkeys(("gold", "silver", "aluminium", "aluminum", "chrome", "nickel"), (OTHER,)),
    **dict.fromkeys(("titanium", "glass", "water", "skin", "hair", "rubber"), (OTHER,)),
    **dict.fromkeys(("leaf", "grass", "ice", "snow", "wax", "porcelain"), (OTHER,)),
}
"""What a word in a name leaves possible.  Where several do, all of them count."""

_RULED_OUT = 0.01
_ANYTHING = 0.05  # how likely anything else always is
_NEAR = 0.02  # a range that is missed by so little is met
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+")


def _from(value: float, low: float, high: float) -> float:
    """0 up to `low`, 1 from `high` on, straight in between."""
    return min(max((value - low) / (high - low), 0.0), 1.0)


def _saturation(color: Iterable[float]) -> float:
    least, _, most = sorted(color)
    return 1 - least / most if most > 0 else 0.0


def substances(surface: Surface) -> dict[str, float]:
    """What the material may be made of, and how probable that is; all together 1."""
    red, green, blue = surface.color
    saturation = _saturation(surface.color)
    brown = _from(saturation, 0.2, 0.5) if red >= green >= blue else 0.0
    colored, bright = _from(saturation, 0.1, 0.4), (red + green + blue) / 3
    fibers, rough = _from(surface.fibers, 1.5, 1.7), _from(surface.roughness, 0.4, 0.7)
    metal = surface.metallic
    # In some places, as where paint has gone.
    bare = surface.textured * _from(metal, 0.002, 0.01) * _from(1 - metal, 0.3, 0.7)
    rusty = brown * _from(saturation, 0.7, 0.85) * _from(surface.roughness, 0.7, 0.85)
    earthy = surface.textured * brown * rough * (1 - rusty)
    plain = (1 - metal) * (1 - fibers)
    found = {
        COPPER: metal * brown,
        STEEL: max(metal * (1 - brown), plain * rusty),
        PAINTED_METAL: bare * (1 - rusty),
        WOOD: (1 - metal) * fibers * brown,
        PAINTED_WOOD: (1 - metal) * fibers * (1 - brown),
        LEATHER: plain * 0.5 * brown * (1 - rough),
        PAINT: plain * 0.9 * colored * (1 - rough) * (1 - bare),
        PLASTIC: plain * 0.8 * (1 - rough) * (1 - bare),
        CLOTH: plain * colored * rough * (1 - rusty) * (1 - bare) * (1 - 0.5 * earthy),
        STONE: plain * max(1 - colored, earthy) * (1 - _from(bright, 0.2, 0.6)),
        CONCRETE: plain * (1 - colored) * _from(bright, 0.1, 0.4),
        OTHER: 0.0,
    }
    weights = {name: share + _ANYTHING for name, share in found.items()}
    words = {word.lower() for name in surface.names for word in _WORD.findall(name)}
    for word in words:
        if possible := _WORDS.get(word) or _WORDS.get(word.removesuffix("s")):
            for name in weights:
                weights[name] *= 1 if name in possible else _RULED_OUT
    whole = sum(weights.values())
    return {name: weight / whole for name, weight in weights.items()}


def ordered(cards: Iterable[ModelCard], surface: Surface) -> list[Suited]:
    """The models, the one that suits `surface` best first; equals in the order they come in."""
    made_of = substances(surface)
    scored = sorted(((_score(card, surface, made_of), card) for card in cards), key=lambda x: -x[0])
    return [
        Suited(card.name, score, "" if score >= DOUBTFUL else _doubt(card, scored[0], made_of))
        for score, card in scored
    ]


def _score(card: ModelCard, surface: Surface, made_of: Mapping[str, float]) -> float:
    purpose = PURPOSES.get(card.process)
    if purpose is None:
        return DOUBTFUL  # nothing is known for it, nor against it
    fits = sum(made_of[name] * well for name, well in purpose.substances.items())
    if purpose.colored:
        fits *= _from(_saturation(surface.color), 0.1, 0.3)
    if purpose.pale:
        fits *= _from(sum(surface.color) / 3, 0.02, 0.1)
    if purpose.glossy:
        fits *= 1 - _from(surface.roughness, 0.25, 0.5)
    return fits * (0.5 + 0.5 * _known(card, surface))


def _known(card: ModelCard, surface: Surface) -> float:
    """The share of the material's numbers that lie where the model was trained."""
    ranges = card.domain.get("ranges")
    if not isinstance(ranges, dict):
        return 1.0
    metal = surface.metallic
    values = {"alpha": surface.roughness**2}
    for channel, value in zip("rgb", surface.color, strict=True):
        values[f"kd_{channel}"] = value * (1 - metal)
        values[f"ks_{channel}"] = value * metal + 0.04 * (1 - metal)
    inside = [
        low - _NEAR <= values[name] <= high + _NEAR
        for name, (low, high) in ranges.items()
        if name in values
    ]
    return sum(inside) / len(inside) if inside else 1.0


def _doubt(card: ModelCard, best: tuple[float, ModelCard], made_of: Mapping[str, float]) -> str:
    likely = max(made_of, key=lambda name: made_of[name])
    purpose = PURPOSES[card.process]
    told = purpose.told[0].lower() + purpose.told[1:]
    looks = "" if likely == OTHER else f"; this looks like {likely}"
    better = f" {best[1].title} suits it better." if best[0] >= DOUBTFUL else ""
    return f"{card.title} is for {told}{looks}.{better}"
