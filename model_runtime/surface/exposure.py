"""What a process likes: where on an object it starts, as weights that an artist can change.

Each name stands for a feature of the surface from 0 to 1, except two: `runs` is what water brings
down, `pattern` how much chance has a say.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from ..contract import check_exposure

if TYPE_CHECKING:  # the add-on reads weights, and has no library for these
    from .atlas import Atlas
    from .graph import Graph
    from .points import Points

__all__ = ("BLOCKED", "MARKS", "SOUGHT", "WEAR", "Exposure", "features", "marked")

Array = NDArray[np.float32]

_QUANTILES = (0.02, 0.99)  # of a feature, that become 0 and 1
_FAINT = 0.6  # power: what is a little sheltered is told from what is not at all
_STRONGEST = 3  # power mean
_BLOCKED = np.float32(3.0)
_SMOOTHED = 3  # times: a bake of few rays is noisy, and so is how points lie
_FLAT = 0.04  # a feature that differs by less, of all that it could, says nothing


WEAR, SOUGHT, BLOCKED = "wear", "sought", "blocked"
MARKS = (WEAR, SOUGHT, BLOCKED)
"""What may be said of texels beside their exposure: that they have begun already and it spreads
from there, that it starts there first, and that it never does.
"""


@dataclass(frozen=True)
class Exposure:
    """Weights from -1 (avoids) to 1 (seeks); `pattern` from 0 (no chance) to 1.

    edges: what sticks out; crevices: what is sheltered from all sides; sky: what the sky sees;
    ground: what is low; runs: what water brings down from where it starts; wear: what is
    weathered already
    """

    edges: float = 0.0
    crevices: float = 0.0
    sky: float = 0.0
    ground: float = 0.0
    runs: float = 0.0
    wear: float = 1.0
    pattern: float = 1.0

    @classmethod
    def of(cls, process: str, card: Mapping[str, Any] | None = None) -> Self:
        """That of a model's `card`, where it has one, on top of the defaults of the process."""
        default = cls(**_PROCESSES.get(process, _UNKNOWN))
        return default if card is None else default.changed(card)

    def changed(self, weights: Mapping[str, Any]) -> Self:
        """With other `weights`.  Raises ValueError for what is no weight."""
        check_exposure(weights)
        return replace(self, **{name: float(weight) for name, weight in weights.items()})

    def json(self) -> dict[str, float]:
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def susceptibility(self, known: Mapping[str, Array]) -> Array:
        """What the features [n] that are `known`, at least one, speak for and against by their
        weights, the strongest nearly alone; less what is `blocked`, which nothing makes up for.
        """
        weighted = [
            np.float32(weight) * known[name]
            for name, weight in self.json().items()
            if name in known
        ]
        total = _together(np.maximum(weighted, 0)) - _together(np.maximum(np.negative(weighted), 0))
        return total - _BLOCKED * known[BLOCKED] if BLOCKED in known else total


_PROCESSES = {
    # Rust begins where paint is thin or broken, which is at edges and welds, and where water stands
    # (ISO 12944-3 asks for rounded edges and no crevices for these reasons); splashes reach what is
    # low, and what rusts stains what lies below. Where it starts is hardly chance.
    "rust": {
        "edges": 0.6,
        "crevices": 0.6,
        "ground": 0.25,
        "sky": 0.1,
        "runs": 0.8,
        "pattern": 0.5,
    },
    # Copper turns green where rain wets it: on what looks up, and in the tracks of what runs off
    # (the Statue of Liberty's sheltered sides stayed brown for decades).
    "patina": {"sky": 0.6, "runs": 0.6, "crevices": 0.2, "pattern": 0.7},
    # Moss needs water that stays and light: what looks up, joints and the foot of a wall; edges dry
    # first.
    "moss": {
        "sky": 0.5,
        "crevices": 0.5,
        "ground": 0.35,
        "edges": -0.5,
        "runs": 0.2,
        "pattern": 0.6,
    },
    # Black crusts form where soot settles and no rain washes it off: in what is sheltered and below
    # ledges, in streaks (Camuffo et al. 1982 told white, washed from black, sheltered areas).
    "soiling": {"runs": 0.7, "crevices": 0.5, "sky": -0.35, "edges": -0.2},
    # Light bleaches: what the sky sees fades first.
    "fading": {"sky": 1.0, "crevices": -0.2, "edges": 0.15, "pattern": 0.6},
    # Flames rise and thin parts burn first: from below, from edges.
    "char": {"ground": 0.7, "edges": 0.5, "sky": -0.3, "crevices": -0.1, "pattern": 0.7},
    # What is exposed to moving air dries first: edges and the top; crevices and the foot stay wet.
    "drying": {"edges": 0.6, "crevices": -0.7, "sky": 0.3, "ground": -0.4, "pattern": 0.6},
    # Light and air yellow what they reach.
    "yellowing": {"sky": 0.8, "crevices": -0.3, "pattern": 0.6},
    # Paint is thin at edges and cracks there first; where water stands behind it, it is pushed off.
    "peeling_metal": {"edges": 0.6, "crevices": 0.4, "ground": 0.2, "sky": 0.2},
    # On wood end grain and joints drink, and the sun opens what looks up.
    "peeling_wood": {"edges": 0.5, "crevices": 0.4, "sky": 0.4, "ground": 0.3},
    # Light breaks lignin down and rain washes it out: what the sky sees turns gray.
    "weathered_wood": {"sky": 0.8, "crevices": -0.4, "edges": 0.2, "pattern": 0.7},
}
_UNKNOWN = {"edges": 0.3, "crevices": 0.3}


def _together(reasons: Array) -> Array:
    """What several reasons [k, n], none below 0, come to: hardly more than the strongest."""
    return np.sum(reasons**_STRONGEST, axis=0) ** np.float32(1 / _STRONGEST)


@lru_cache(maxsize=1)
def features(atlas: Atlas, points: Points, graph: Graph) -> Mapping[str, Array]:
    """What is known of each point, 0 to 1, by its name in `Exposure`: [n] each; the last surface's
    are kept, as its points are.

    What has not been baked follows from the points: how the surface bends, and what looks up.
    """
    apart = graph.between(points.position)
    bend = np.einsum("kni,kni->kn", graph.between(points.normal), apart)
    known = np.isfinite(graph.distance)
    bend = np.where(known, bend / np.where(known, graph.distance, 1) ** 2, 0).sum(0)
    bend *= points.spacing / np.maximum(known.sum(0), 1)
    height = points.position[:, 2]
    found = {
        "edges": bend.clip(0, 1),
        "crevices": (-bend).clip(0, 1),
        "sky": np.maximum(points.normal[:, 2], 0),
        "ground": -height / max(atlas.extent, 1e-9),
    }
    for name, pixels in atlas.features.items():
        found[name] = points.mean_of(pixels)
    for name in ("edges", "crevices", "sky"):
        for _ in range(_SMOOTHED):
            found[name] = graph.smoothed(found[name])
    return {
        name: values if name == BLOCKED else _from_0_to_1(values, points.area)
        for name, values in found.items()
    }


def marked(points: Points, marks: Mapping[str, Array]) -> dict[str, Array]:
    """What is said (`MARKS`) of each point by maps [H, W] of its atlas: [n] each."""
    found = {name: points.mean_of(pixels) for name, pixels in marks.items()}
    if WEAR in found:
        found[WEAR] = _from_0_to_1(found[WEAR], points.area)
    return found


def _from_0_to_1(values: Array, area: Array) -> Array:
    order = np.argsort(values)
    share = np.cumsum(area[order], dtype=np.float64) / area.sum(dtype=np.float64)
    low, high = np.interp(_QUANTILES, share, values[order])
    if high - low < _FLAT:
        return np.zeros_like(values)
    return (((values - low) / (high - low)).clip(0, 1) ** _FAINT).astype(np.float32)
