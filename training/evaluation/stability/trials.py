"""What a stress is: a setup in which methods learn and continue, made worse by degrees."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from model_runtime.brdf import torrance_sparrow
from model_runtime.brdf.measured import MeasuredBRDF
from model_runtime.channels import optics
from model_runtime.contract import LADDER
from model_runtime.maps import TorranceSparrowMaps

from ...data.kinetics import history
from ...data.sequences import Sequence, uniform_times
from ..synthesis.cases import CORNERS, Case, patches
from ..synthesis.stage import Stage

__all__ = ("EVERY", "GivenStage", "Stress", "Trial", "TrialSetup", "grown")

EVERY = ("ours", "paper", "stt", "staf", *LADDER)
"""The methods of the report, as `evaluate synthesis` names them."""

FRAMES = 36
_SCORED = 4


@dataclass(frozen=True)
class TrialSetup:
    """Patches `size` texels wide of the materials in `data`/pbr, and what happens to them.

    Most stresses disturb one setup: paint that fades (`kinetics`), the source one patch of
    ambientCG's PaintedWood007B, the target another. No rung of the ladder is exact there, and
    before it is disturbed every method holds.
    """

    data: Path
    size: int

    PROCESS = "fading"
    MATERIAL = "PaintedWood007B"

    def patches(self, material: str = MATERIAL) -> tuple[TorranceSparrowMaps, TorranceSparrowMaps]:
        """Source and target of a material, apart from each other."""
        return patches(self.data / "pbr" / material, self.size)

    @cached_property
    def source(self) -> Sequence:
        """The undisturbed source."""
        return grown(self.patches()[0])

    @property
    def target_box(self) -> tuple[int, int, int, int]:
        """Where the target lies in its material's images: left, top, right, bottom."""
        y, x = CORNERS[1]
        return x, y, x + self.size, y + self.size

    @cached_property
    def start(self) -> TorranceSparrowMaps:
        """The undisturbed target's first frame."""
        return self.patches()[1]

    def case(
        self,
        *,
        start: TorranceSparrowMaps | None = None,
        target: Sequence | None = None,
        source: Sequence | None = None,
        key: str = "",
    ) -> Case:
        """The setup's case, with another beginning or another truth of the target, or another
        source, which then needs a `key` of its own.
        """
        assert (source is None) == (key == "")
        if target is None:
            target = grown(self.start if start is None else start)
        name = f"stability_{key or self.PROCESS}"
        return Case(name, self.MATERIAL, source or self.source, target, name, self.PROCESS)


def grown(
    maps: TorranceSparrowMaps, *, times: NDArray[np.float32] | None = None, until: float = 1.0
) -> Sequence:
    """What the setup's process makes of `maps` at `times` (0 to 1, by default 36 even ones), the
    last of which is the age `until`.
    """
    times = uniform_times(FRAMES) if times is None else times
    aged = [
        history(TrialSetup.PROCESS, maps.kd, maps.ks, maps.alpha, np.full(maps.size, until * t))
        for t in times
    ]
    kd, ks, alpha = (np.stack(each).astype(np.float32) for each in zip(*aged, strict=True))
    return Sequence(kd, ks, alpha, times, None, TrialSetup.PROCESS)


@dataclass(frozen=True)
class Trial:
    """One stress at one severity.

    case: what is learned from, and what is true
    given: the first frame as methods are given it; None: as it is
    unscored: texels [H, W] that do not count; None: all do
    last_only: whether only the last frame is scored, instead of four evenly spaced ones
    span: how long the target is, in units of the source's time
    palette, samples: how many materials may be modeled, how many directions encoders see
    dtype: the number format in which everything given and learned is stored
    killed: the share of the training after which it is killed, and resumed
    measured: a material that is to come back in the first frame, where nothing is to be continued
    """

    case: Case
    given: TorranceSparrowMaps | None = None
    unscored: NDArray[np.bool_] | None = None
    last_only: bool = False
    span: float = 1.0
    palette: int | None = None
    samples: int | None = None
    dtype: torch.dtype | None = None
    killed: float | None = None
    measured: MeasuredBRDF | None = None

    @property
    def frames(self) -> list[int]:
        """The frames that are scored, counted from 0; the given one never is."""
        last = len(self.case.target.times) - 1
        if self.last_only:
            return [last]
        return sorted({max(1, round(last * k / _SCORED)) for k in range(1, _SCORED + 1)})


@dataclass(frozen=True)
class GivenStage(Stage):
    """A stage whose first frame methods see as `given` and not as it is."""

    given: TorranceSparrowMaps | None = None

    @cached_property
    def initial(self) -> TorranceSparrowMaps:
        """The first frame: what methods are given."""
        return super().initial if self.given is None else self.given

    def values(self, frame: int, pixels: Tensor, angles: Tensor) -> Tensor:
        """f [p, M, 3] of the texels at `pixels` [p] in a frame, the first one as given."""
        if self.given is None or frame > 0:
            return super().values(frame, pixels, angles)
        some = self.start[self.texels[pixels]]
        return torrance_sparrow.evaluate(*optics(some), angles)


@dataclass(frozen=True)
class Stress:
    """What is made worse: `make`(setup, severity) -> trial, from harmless to absurd.

    axis: what the severities count. methods: those to which it applies; `note` says why not to
    others, or what else a reader must know. labels: what severities are called where numbers say
    little.
    """

    title: str
    axis: str
    severities: tuple[float, ...]
    make: Callable[[TrialSetup, float], Trial]
    methods: tuple[str, ...] = EVERY
    note: str = ""
    labels: Mapping[float, str] = field(default_factory=dict)
