"""Whether a model of change knows what it does not know: ROC curves of the bundled NTMs' domains.

In-domain are tiles of a process that no training saw (other seeds) and one real material that it is
meant for; foreign are ten real materials, named here by what the process is not for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from torch import Tensor

from model_runtime.brdf import principled
from model_runtime.brdf.fit import fit_angles, fit_torrance_sparrow
from model_runtime.maps import PrincipledMaps
from model_runtime.model_files.weights import ModelCard
from model_runtime.reading.inputs import read_input
from model_runtime.states import rows_of
from model_runtime.temporal.domain import FOREIGN_SHARE, Domain
from model_runtime.temporal.ntm import NeuralTemporalModel

from ...data.nbrdf import load
from ...data.weathering import generate
from ..bench.aging import texels_of
from ..bench.results import Result

__all__ = ("FITTING", "FOREIGN", "DomainResult", "domain_roc", "judged", "roc")

Array = NDArray[np.float64]

_SEEDS = (1, 2, 3, 4, 5)
"""Tiles no bundled NTM was trained on: those have seed 0."""

_SIZE = 96
_TEXELS = 1024  # of a material, so that all weigh the same
_METALS = ("pbr/Metal024", "pbr/Metal032", "pbr/Metal035", "merl/nickel")  # iron, steel, copper
_SILVER, _WHITE = "merl/silver-metallic-paint", "rgl-isotropic/spectralon_rgb"
_ORANGE_CHROME, _BLUE_CHROME = "rgl-isotropic/chm_orange_rgb", "rgl-isotropic/chm_light_blue_rgb"
_GOLDEN_CHROME, _RED_CHROME, _PINK_CHROME = (
    f"rgl-isotropic/vch_{name}_rgb" for name in ("golden_yellow", "dragon_eye_red", "ultra_pink")
)

FITTING = {
    "rust": "pbr/Metal024",
    "patina": "pbr/Metal035",
    "char": "pbr/Wood049",
    "drying": "pbr/Granite002A",
    "fading": "pbr/PaintedWood007B",
    "soiling": "pbr/Plastic005",
    "yellowing": "pbr/Wood049",
    "moss": "pbr/Wood049",
}
"""By process, the real material that it is meant for: steel, copper, oak, wet stone, blue paint,
pale plastic, varnished oak, wood."""

FOREIGN = {
    # not for colored metals and lacquers, nor for cloth and foam
    "rust": (
        *("pbr/Metal035", _ORANGE_CHROME, _BLUE_CHROME, _GOLDEN_CHROME, _RED_CHROME),
        *(_PINK_CHROME, "merl/gold-metallic-paint", "merl/light-brown-fabric"),
        *("merl/black-fabric", "merl/polyurethane-foam"),
    ),
    # not for gray metals, nor for what is no metal
    "patina": (
        *("pbr/Metal024", "pbr/Metal032", "pbr/Wood049", "pbr/Plastic005", "pbr/Granite002A"),
        *("pbr/Fabric045", "pbr/PaintedMetal004", "pbr/Leather028"),
        *("merl/silver-metallic-paint2", "merl/white-paint"),
    ),
    # not for metals
    "char": (
        *(*_METALS, _SILVER, "merl/silver-metallic-paint2", "merl/gold-metallic-paint"),
        *(_ORANGE_CHROME, _BLUE_CHROME, _GOLDEN_CHROME),
    ),
    # not for metals, nor for what is dry
    "drying": (
        *(*_METALS, _SILVER, "pbr/Rust004", "merl/light-brown-fabric", _ORANGE_CHROME),
        *(_BLUE_CHROME, _WHITE),
    ),
    # not for metals, nor for what has no dye to lose
    "fading": (
        *(*_METALS, _SILVER, "pbr/Granite002A", "pbr/Fabric045", _BLUE_CHROME, _WHITE),
        "rgl-isotropic/cm_white_rgb",
    ),
    # not for metals, nor for what is dark already
    "soiling": (
        *(*_METALS, _SILVER, "merl/black-fabric", "merl/black-obsidian"),
        *("merl/black-soft-plastic", "merl/black-oxidized-steel", _ORANGE_CHROME),
    ),
    # not for metals, nor for what is matte
    "yellowing": (
        *(*_METALS, _SILVER, "pbr/Rust004", "merl/light-brown-fabric", "merl/black-fabric"),
        *("merl/pink-felt", _BLUE_CHROME),
    ),
    # not for metals, gloss or vivid paint
    "moss": (
        *(*_METALS[:3], "pbr/PaintedMetal004", "pbr/PaintedMetal007", "pbr/Plastic005"),
        *("pbr/Granite002A", "merl/alumina-oxide", "merl/red-metallic-paint"),
        "merl/chrome-steel",
    ),
}
"""By process, ten real materials that it is not meant for: ambientCG's textures, and measured ones
of MERL and RGL as the product fits them."""


@dataclass(frozen=True)
class DomainResult(Result):
    """How one domain judges materials.

    false_alarms, caught: [n] the ROC curve, shares of texels of in-domain and of foreign materials
    beyond each threshold of the distance, every material weighing the same. outside: by material,
    the share of its texels beyond the threshold of the product. fitting: those that are in-domain.
    `accepted` and `refused` as the product decides, and the decisions that are `wrong`.
    """

    JSON = (("auroc", 4), ("accepted", None), ("refused", None), ("wrong", None), ("outside", 3))

    false_alarms: Array
    caught: Array
    outside: Mapping[str, float]
    fitting: tuple[str, ...]

    @property
    def auroc(self) -> float:
        """The area under the curve: 1 where every foreign texel is farther than any other."""
        return float(trapezoid(self.caught, self.false_alarms))

    @property
    def refused(self) -> list[str]:
        return [name for name, share in self.outside.items() if share > FOREIGN_SHARE]

    @property
    def accepted(self) -> list[str]:
        return [name for name in self.outside if name not in self.refused]

    @property
    def wrong(self) -> list[str]:
        return [n for n in self.outside if (n in self.refused) == (n in self.fitting)]


def domain_roc(models: Sequence[ModelCard], data: Path) -> dict[str, DomainResult]:
    """How the domains of `models` (cards of NTM files) judge materials from the folder `data`, by
    name; models of processes that are not ours (see `FOREIGN`) are left out.

    Raises `ModelFileError` for files that hold no NTM.
    """
    results = {}
    for card in models:
        if card.process in FOREIGN:
            ntm = NeuralTemporalModel.load(card.path, card.representation)
            results[card.name] = judged(ntm.domain, card.process, data)
    return results


def judged(domain: Domain, process: str, data: Path) -> DomainResult:
    """How `domain` judges what `process` is meant for and what it is not."""
    fitting = {f"seed {seed}": _tile(process, seed) for seed in _SEEDS}
    fitting |= _materials((FITTING[process],), data)
    foreign = _materials(FOREIGN[process], data)
    near, far = (
        {name: domain.distance(states) for name, states in some.items()}
        for some in (fitting, foreign)
    )
    false_alarms, caught = roc(list(near.values()), list(far.values()))
    outside = {name: float((d > 1).float().mean()) for name, d in (near | far).items()}
    return DomainResult(false_alarms, caught, outside, tuple(near))


def roc(near: Sequence[Tensor], far: Sequence[Tensor]) -> tuple[Array, Array]:
    """Shares of `near` and of `far` beyond every threshold, from the highest to the lowest: [n]
    each, 0 to 1. Both are lists of distances, one [m] a material; all materials weigh the same.
    """
    thresholds = torch.cat((torch.tensor([-1.0]), *near, *far)).unique().flip(0)

    def beyond(materials: Sequence[Tensor]) -> Array:
        shares = [
            1 - torch.searchsorted(d.sort().values, thresholds, right=True) / len(d)
            for d in materials
        ]
        return torch.stack(shares).double().mean(0).numpy()

    return beyond(near), beyond(far)


def _tile(process: str, seed: int) -> Tensor:
    """Initial states [1024, C] of another tile of `process`."""
    return _drawn(texels_of(generate(process, size=_SIZE, frames=2, seed=seed))[0].flatten(0, 1))


def _materials(names: Sequence[str], data: Path) -> dict[str, Tensor]:
    """Initial states [m, C] of textures and of measured materials `folder/name` in `data`."""
    return {name: _material(name, data) for name in names}


def _material(path: str, data: Path) -> Tensor:
    folder, name = path.split("/")
    if folder != "pbr":
        brdf = load(data, folder).select([name])
        f = brdf.evaluate(torch.arange(1), fit_angles())
        return fit_torrance_sparrow(f).parameters()
    material = read_input(data / "pbr" / name)
    assert isinstance(material, PrincipledMaps)
    return _drawn(rows_of(principled.forward(material)))


def _drawn(states: Tensor) -> Tensor:
    """A thousand texels of [n, C]."""
    return states[:: max(1, len(states) // _TEXELS)].float()
