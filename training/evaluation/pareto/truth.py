"""How near settings and rivals come to histories that are known: S1, S2 and S3."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

from model_runtime.brdf.fit import fit_angles, fit_torrance_sparrow
from model_runtime.brdf.torrance_sparrow import evaluate
from model_runtime.channels import WIDTH, optics
from model_runtime.contract import AUTO, LSTM_LATENTS
from model_runtime.model_files.weights import ESTIMATOR
from model_runtime.modelling.aged import Change, Effort, model_texels
from model_runtime.reading.inputs import hash_file
from model_runtime.representation.estimator import ParameterEstimator, load_estimator
from model_runtime.representation.latents import PAPER_SAMPLES, Representation
from model_runtime.temporal.models import LatentLSTM

from ..bench.encoders import WEIGHTS
from ..bench.kept import code, identity, kept_json
from ..bench.spheres import TexturedSphere
from ..synthesis.cases import make_cases
from ..synthesis.methods import Models, Rung, Transferred, load_models, method_for
from ..synthesis.results import Curve
from ..synthesis.scoring import Scorer
from ..synthesis.sources import Effort as Learning
from ..synthesis.sources import SourceModels, describe
from ..synthesis.stage import Stage

__all__ = ("CASES", "RIVALS", "Truth", "TruthRun", "paper_pipeline_seconds")

CASES = ("s1_a0.8_b0.1", "s2_a0.8_b0.1", "s3")
RIVALS = ("stt", "staf", "paper")


@dataclass(frozen=True)
class TruthRun:
    """psnr: dB by case, over all frames but the given one.
    seconds: of one core, to model all frames of one case; a mean over the cases.
    extrapolated: whether fewer texels were timed than the cases have.
    """

    psnr: Mapping[str, float]
    seconds: float
    extrapolated: bool


@dataclass(frozen=True)
class Truth:
    """The first material of each of `CASES`, `pixels` wide, and the `folder` where
    what is learned of them stays.

    Methods that model latents texel by texel are given every `stride`-th row and column of the
    sphere. `weights` is the folder of the paper's trained encoder, whose pipeline is timed on
    `paper_texels`.
    """

    data: Path
    folder: Path
    pixels: int = 64
    stride: int = 6
    learning: Learning = field(default_factory=Learning)
    weights: Path = WEIGHTS
    paper_texels: int = 4

    def setting(self, name: str, effort: Effort, rung: str) -> TruthRun:
        """Aging with `effort` by `rung`, or "auto", of a ladder trained on the case's source, from
        the parameters of the target's first frame, as maps hold them.
        """

        def one(stage: Stage) -> tuple[float, float, bool]:
            method = self._ladder(stage)
            used = method.rung(stage) if rung == AUTO else rung
            dear = used == LSTM_LATENTS and effort.step == 0 and effort.fit
            pixels = stage.sphere.few if dear else torch.arange(len(stage.texels))
            start = stage.start[stage.texels[pixels]] if dear else stage.start
            clock = time.process_time()
            aged = model_texels(
                start,
                Change(method.ntm, used, method.representation, self._estimator),
                effort,
                tolerance=45.0,
            )
            frames = list(range(1, stage.frames))
            states = torch.stack([aged.at(frame / (stage.frames - 1)) for frame in frames])
            seconds = (time.process_time() - clock) * len(stage.start) / len(start)
            shown = states if dear else states[:, stage.texels]
            scores = stage.score(stage.sphere.render(shown, pixels), frames, pixels)
            return _mean(scores, frames, stage.frames), seconds, dear

        return self._run(name, f"{effort} {rung}", one)

    def rival(self, name: str) -> TruthRun:
        """STT, STAF or the paper's method; the last one is timed with its own 16,200 samples on
        a few texels, as far as maps: with the fit.
        """

        def one(stage: Stage) -> tuple[float, float, bool]:
            look = f"{self.pixels} {self.stride}"
            scorer = Scorer(stage.case, lambda: stage, self._models, self.folder, look)
            psnr = scorer.score(name).curves["score"].json()["mean"]
            method = scorer.method(name)
            if isinstance(method, Transferred):
                clock = time.process_time()
                method.model.synthesize(stage.initial, stage.case.target.times)
                return psnr, time.process_time() - clock, False
            representation, _ = self._models.encoders["paper"]
            seconds = paper_pipeline_seconds(representation, stage.start[: self.paper_texels])
            return psnr, seconds * len(stage.start), True

        return self._run(name, name, one)

    def paper_seconds(self) -> float:
        """Of one core, that the paper's pipeline takes for a texel and its 36 frames."""
        representation, _ = self._models.encoders["paper"]
        states = torch.rand(self.paper_texels, WIDTH, generator=torch.Generator().manual_seed(0))
        return paper_pipeline_seconds(representation, states)

    def _run(
        self, name: str, what: str, one: Callable[[Stage], tuple[float, float, bool]]
    ) -> TruthRun:
        look = f"{what} {self.pixels} {self.stride} {self.learning}"
        encoders = (encoder for _, encoder in self._models.encoders.values())
        made_from = identity(look, code(), *encoders, hash_file(ESTIMATOR), *self._described)

        def make() -> dict[str, object]:
            found = [one(stage) for stage in self._stages]
            names = (stage.case.name for stage in self._stages)
            psnr = {name: round(each[0], 3) for name, each in zip(names, found, strict=True)}
            seconds = sum(each[1] for each in found) / len(found)
            return asdict(TruthRun(psnr, round(seconds, 4), any(each[2] for each in found)))

        path = self.folder / f"truth_{name}.json".replace(" ", "_").replace("/", "by")
        return TruthRun(**kept_json(path, made_from, make))

    def _ladder(self, stage: Stage) -> Rung:
        """Trained on the case's source; asked for by every setting."""
        if stage.case.key not in self._trained:
            method = method_for("ours", stage.case, self._models)
            assert isinstance(method, Rung)
            self._trained[stage.case.key] = method
        return self._trained[stage.case.key]

    @cached_property
    def _trained(self) -> dict[str, Rung]:
        return {}

    @cached_property
    def _models(self) -> Models:
        sources = SourceModels(self.folder, self.learning)
        return load_models(("ours", *RIVALS), sources, weights=self.weights)

    @cached_property
    def _estimator(self) -> ParameterEstimator:
        return load_estimator(self._models.encoders["ours"][1])

    @cached_property
    def _stages(self) -> list[Stage]:
        sphere = TexturedSphere.load(
            self.data / "hdri", pixels=self.pixels, stride=self.stride, folder=self.folder
        )
        cases = (next(iter(make_cases(self.data, (name,), size=self.pixels))) for name in CASES)
        return [Stage.of(case, sphere) for case in cases]

    @cached_property
    def _described(self) -> list[str]:
        return [f"{describe(s.case.source)} {describe(s.case.target)}" for s in self._stages]


def paper_pipeline_seconds(
    representation: Representation, states: Tensor, *, frames: int = 36
) -> float:
    """Of one core, for each of `states` [n, C]: encode 16,200 samples, roll `frames` out, decode
    each at the directions of the fit, and fit. How a model was trained does not matter to this.
    """
    model = LatentLSTM(*representation.latent_sizes)
    angles, wanted = representation.sample_angles(PAPER_SAMPLES), fit_angles()
    clock = time.process_time()
    with torch.inference_mode():
        for state in states.split(1):
            f = evaluate(*optics(state), angles)
            latents = representation.encode(angles, f)
            flat = model.rollout(latents.flat(), frames)
            fit_torrance_sparrow(representation.decode(latents.unflat(flat), wanted))
    return (time.process_time() - clock) / len(states)


def _mean(scores: list[float], frames: list[int], length: int) -> float:
    return Curve(tuple(frames), tuple(scores), length).json()["mean"]
