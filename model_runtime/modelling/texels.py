"""What every texel starts as, and when: from a material as it was read to what is modeled."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..backend import Tensor, torch
from ..brdf import principled
from ..brdf.measured import MeasuredBRDF
from ..contract import AUTO, EVERYWHERE, AgeRequest, exposure_weights, start_places
from ..errors import InputError, ModelFileError, shown
from ..images import read_image
from ..maps import Pixels, PrincipledMaps, TorranceSparrowMaps
from ..reading.coverage import nearest_covered
from ..reading.inputs import Material
from ..resampling import resize
from ..surface.atlas import Atlas
from ..surface.exposure import WEAR, Exposure
from ..surface.light import lit_timing
from ..surface.timing import SurfaceTiming, surface_timing
from ..temporal.ntm import NeuralTemporalModel
from ..temporal.onset import onset_map, rate_map
from ..temporal.wear import stains_of
from .compose import AgedTexels
from .measured import MeasuredFit, fit_measured
from .residues import Residues

__all__ = (
    "Texels",
    "authored_texels",
    "exposure_of",
    "grown_timing",
    "initial_states",
    "timing_maps",
)

_UNIFORM_SIZE = 512


def initial_states(
    material: Material, request: AgeRequest
) -> tuple[Tensor, tuple[int, int], MeasuredFit | None]:
    """States [n, C] of all texels at t = 0, the size in texels, and the fit of what is measured."""
    if isinstance(material, MeasuredBRDF):
        fit = fit_measured(material, request)
        return fit.lobed.states, (1, 1), fit
    maps = principled.forward(material) if isinstance(material, PrincipledMaps) else material
    if request.specular == "mono" and isinstance(material, TorranceSparrowMaps):
        maps = replace(maps, ks=np.repeat(maps.ks.mean(-1, keepdims=True), 3, -1))
    return torch.from_numpy(maps.planes()).T, maps.size, None


@dataclass(frozen=True)
class Texels:
    """Initial states [n, C], when [n] and how fast [n] they age, and what they show beyond their
    histories, row by row of the image.
    """

    initial: Tensor
    onset: Tensor | None
    rate: Tensor | None
    residues: Residues | None = None

    @classmethod
    def of(
        cls,
        initial: Tensor,
        onset: Pixels | None,
        rate: Pixels | None,
        residues: Residues | None = None,
    ) -> Texels:
        """From states and the maps [H, W] of `timing_maps`."""
        when, how_fast = (
            None if pixels is None else torch.from_numpy(pixels.reshape(-1))
            for pixels in (onset, rate)
        )
        return cls(initial, when, how_fast, residues)

    def where(self, covered: NDArray[np.bool_]) -> Texels:
        """Those that are `covered` [H, W]."""
        rows = torch.from_numpy(np.flatnonzero(covered))
        return Texels(
            self.initial.T[:, rows].T,
            None if self.onset is None else self.onset[rows],
            None if self.rate is None else self.rate[rows],
            None if self.residues is None else self.residues.select(rows),
        )

    def beside(self, aged: AgedTexels, covered: NDArray[np.bool_]) -> AgedTexels:
        """All, of which `aged` are the covered ones: the others follow the nearest of these."""
        place = np.cumsum(covered) - 1
        rows = torch.from_numpy(place[nearest_covered(covered).reshape(-1)])
        palette = replace(aged.palette, index=aged.palette.index[rows])
        residues = aged.residues
        if residues is not None and self.residues is not None:
            residues = replace(residues, coefficients=self.residues.coefficients)
        return replace(
            aged,
            initial=self.initial,
            palette=palette,
            onset=self.onset,
            rate=self.rate,
            residues=residues,
        )


def authored_texels(
    maps: PrincipledMaps, size: tuple[int, int], covered: NDArray[np.bool_] | None
) -> PrincipledMaps:
    """The sockets of every texel of an image of `size`, or as a column of those that are
    `covered`.
    """
    whole = maps.map(lambda pixels: np.broadcast_to(pixels, size + pixels.shape[2:]))
    return whole if covered is None else whole.map(lambda pixels: pixels[covered][:, None])


def exposure_of(request: AgeRequest, ntm: NeuralTemporalModel) -> Exposure:
    """Where the process starts: as its model's card says, and as the artist wants it.

    Raises ModelFileError where the card has no proper exposure.
    """
    card = ntm.card
    try:
        exposure = Exposure.of(card.process, card.details.get("exposure"))
    except (AttributeError, ValueError) as error:
        raise ModelFileError(
            f"{shown(card.path.name)} does not say where it starts: {shown(error)}.",
            "Copy or download it again.",
        ) from error
    return exposure.changed(exposure_weights(request.exposure or ""))


def timing_maps(
    request: AgeRequest,
    ntm: NeuralTemporalModel,
    size: tuple[int, int],
    worn: NDArray[np.bool_] | None = None,
) -> tuple[Pixels | None, Pixels | None]:
    """When each texel's history starts, 0 to 1, and how fast it runs: [H, W] each.

    An image says only when: its rate is None, which stands for 1. Without any (both None) all
    texels change alike, as those of the source did on average; so they do in a pattern after a
    source that changed everywhere at once. In a pattern what is `worn` [H, W] starts at once.
    """
    timing, process, seed = ntm.timing, ntm.card.process, request.seed
    if request.onset == EVERYWHERE or (request.onset == AUTO and ntm.changes_at_once):
        return None, None
    if request.onset == AUTO:
        side = request.size or _UNIFORM_SIZE
        shape = (side, side) if size == (1, 1) else size
        with ThreadPoolExecutor(1) as beside:
            rate = beside.submit(rate_map, process, shape, seed=seed, timing=timing)
            onset = onset_map(process, shape, seed=seed, timing=timing, worn=worn)
            return onset, rate.result()
    onset = read_image(Path(request.onset), color=False)
    if not (np.isfinite(onset).all() and onset.min() >= 0 and onset.max() <= 1):
        raise InputError(
            f"The onset image {shown(request.onset)} has values outside 0 to 1.",
            "Paint 0 where the change starts at once and 1 where it never starts.",
        )
    if size == (1, 1):
        scale = (request.size or max(onset.shape)) / max(onset.shape)
        height, width = (max(1, round(length * scale)) for length in onset.shape)
        size = (height, width)
    return resize(onset, size), None


def grown_timing(
    request: AgeRequest,
    ntm: NeuralTemporalModel,
    size: tuple[int, int],
    atlas: Atlas,
    exposure: Exposure,
    worn: NDArray[np.bool_] | None = None,
    marks: Mapping[str, Pixels] | None = None,
    light: Pixels | None = None,
) -> SurfaceTiming:
    """The same by growth over the surface that `atlas` shows, of whose texels `marks` tell more, or
    by the `light` that falls on them, at its own shape where the material is uniform.
    """
    marks = dict(marks or {})
    if worn is not None:
        marks[WEAR] = resize(worn.astype(np.float32), atlas.size)
    if size == (1, 1):
        scale = (request.size or _UNIFORM_SIZE) / max(atlas.size)
        size = max(1, round(atlas.size[0] * scale)), max(1, round(atlas.size[1] * scale))
    if light is not None:
        return lit_timing(atlas, light, size, amount=request.amount, marks=marks)
    return surface_timing(
        atlas,
        ntm.card.process,
        size,
        seed=request.seed,
        exposure=exposure,
        timing=ntm.timing,
        pattern_size=request.pattern_size,
        amount=request.amount,
        stains=stains_of(ntm),
        starts=start_places(request.starts or ""),
        marks=marks,
    )
