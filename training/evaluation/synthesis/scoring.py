"""One method on one case: its scores and pictures, kept until anything they depend on changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

from ...data.sequences import Sequence
from ..bench.kept import code, identity, kept, kept_json
from ..bench.spheres import picture
from .cases import Case
from .methods import Decoded, Method, Models, Rung, method_for
from .results import Curve
from .sources import describe
from .stage import Stage
from .statistics import Rows, spot_statistics, states_with_true_onset

__all__ = ("Scored", "Scorer", "strip_frames")

_EVERY = 5
_STRIP = 5


@dataclass(frozen=True)
class Scored:
    """`curves`: "score", and where there is one "ceiling", "after_fit", that of "two_lobes" and of
    "three_lobes", and "true_onset"; `statistics` as `spot_statistics` gives them; `chosen`, the
    rung that was used, of `LADDER`.
    """

    curves: dict[str, Curve]
    statistics: Mapping[str, Rows] = field(default_factory=dict)
    chosen: str | None = None


def strip_frames(length: int) -> list[int]:
    """The frames of a strip, counted from 0: of 36 the paper's 1, 9, 18, 27, 36."""
    return [0, *(length * k // (_STRIP - 1) - 1 for k in range(1, _STRIP))]


@dataclass
class Scorer:
    """A case and all that its methods have in common; nothing is computed before it is needed.
    `look` identifies the sphere, results are kept in `folder`.
    """

    case: Case
    make_stage: Callable[[], Stage]
    models: Models
    folder: Path
    look: str
    methods: dict[str, Method] = field(default_factory=dict)

    @cached_property
    def stage(self) -> Stage:
        """The case on its sphere."""
        return self.make_stage()

    @cached_property
    def _described(self) -> str:
        case = self.case
        return f"{describe(case.source)} {describe(case.target)} {case.process} {code()}"

    def method(self, name: str) -> Method:
        """Trained on the case's source."""
        if name not in self.methods:
            self.methods[name] = method_for(name, self.case, self.models)
        return self.methods[name]

    def score(self, name: str) -> Scored:
        """From an earlier run, or anew."""
        path = self.folder / f"{self.case.key}_{name}.json"
        made_from = identity(self._described, self._of_method(name), self.look)
        found = kept_json(path, made_from, lambda: asdict(self._scored(name)))
        curves = {
            kind: Curve(tuple(c["frames"]), tuple(c["psnr"]), c["length"])
            for kind, c in found["curves"].items()
        }
        return Scored(curves, found["statistics"], found["chosen"])

    def strip(self, name: str | None, stride: int) -> Tensor:
        """Tone-mapped pixels [t, p, 3] of a method (None: the truth) in the frames of a strip, of
        every `stride`-th row and column.
        """
        path = self.folder / f"strip_{self.case.key}_{name or 'truth'}.safetensors"
        method = "" if name is None else self._of_method(name)
        made_from = identity(self._described, method, f"{self.look} {stride}")

        def make() -> dict[str, Tensor]:
            frames = strip_frames(self.stage.frames)
            row, column = self.stage.sphere.sphere.inside.nonzero().T
            pixels = ((row % stride == 0) & (column % stride == 0)).nonzero()[:, 0]
            if name is None:
                return {"pixels": picture(self.stage.truth[frames][:, :, pixels])}
            return {"pixels": picture(self.method(name).estimate(self.stage, frames, pixels))}

        return kept(path, made_from, make)["pixels"]

    def _of_method(self, name: str) -> str:
        if name in ("stt", "staf"):
            return name
        encoders = self.models.encoders
        _, encoder = encoders[name] if name in encoders else encoders["ours"]
        return f"{name} {encoder} {self.models.sources.effort}"

    def _scored(self, name: str) -> Scored:
        stage, method = self.stage, self.method(name)
        dear, frames, pixels = method.dear(stage), *self._looked_at(method)
        curves = {"score": self._curve(method.estimate(stage, frames, pixels), frames, pixels)}
        if isinstance(method, Decoded) or (isinstance(method, Rung) and dear):
            some = sorted({0, stage.frames // 3, 2 * stage.frames // 3, stage.frames - 1})
            curves["ceiling"] = self._curve(method.ceiling(stage, some, pixels), some, pixels)
        if not isinstance(method, Rung):
            return Scored(curves)
        if stage.measured:
            states = method.states(stage, frames, pixels)
            fitted = stage.sphere.render(states, pixels)
            curves["after_fit"] = self._curve(fitted, frames, pixels)
        if stage.measured and name == "ours" and dear:
            decoded, gain = method.decoded(), method.ntm.affine.gain
            for count, kind in enumerate(("two_lobes", "three_lobes"), start=2):
                shown = decoded.lobed(stage, gain, frames, pixels, count)
                curves[kind] = self._curve(shown, frames, pixels)
        target = self.case.target
        if isinstance(target, Sequence) and target.onset is not None:
            states = states_with_true_onset(stage, method, frames, pixels)
            told = stage.sphere.render(states, pixels)
            curves["true_onset"] = self._curve(told, frames, pixels)
        statistics = {}
        spotted = name == "ours" and self.case.name.startswith(("s4", "real"))
        if spotted:
            statistics = spot_statistics(stage, method, self._estimated())
        return Scored(curves, statistics, method.rung(stage))

    def _estimated(self) -> Rung | None:
        """The product where it has to estimate the onset that the source brings; None where the
        source brings none.
        """
        source, key = self.case.source, self.case.source_key
        if not isinstance(source, Sequence) or source.onset is None:
            return None
        representation, encoder = self.models.encoders["ours"]
        ntm = self.models.sources.ladder(key, source, representation, encoder, onset=False)
        return Rung(ntm, representation, None)

    def _looked_at(self, method: Method) -> tuple[list[int], Tensor]:
        """All frames and pixels; of a dear method few."""
        stage = self.stage
        if not method.dear(stage):
            return list(range(stage.frames)), torch.arange(len(stage.texels))
        return sorted({0, 1, *range(_EVERY, stage.frames, _EVERY), stage.frames - 1}), (
            stage.sphere.few
        )

    def _curve(self, radiance: Tensor, frames: list[int], pixels: Tensor) -> Curve:
        scores = self.stage.score(radiance, frames, pixels)
        return Curve(tuple(frames), tuple(scores), self.stage.frames)
