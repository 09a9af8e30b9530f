"""The methods that the report `synthesis` compares: how each continues a target's first frame."""

from __future__ import annotations

from collections.abc import Sequence as Names
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import torch
from torch import Tensor

from model_runtime.brdf import lobes
from model_runtime.brdf.fit import fit_angles, fit_torrance_sparrow
from model_runtime.brdf.lobes import LobedFit, following, one_more
from model_runtime.brdf.refinement import Measurements, fit_seen
from model_runtime.brdf.views import views
from model_runtime.channels import FURTHER, WIDTH
from model_runtime.contract import LADDER, LSTM_LATENTS
from model_runtime.model_files.weights import ENCODER
from model_runtime.modelling.aged import Change
from model_runtime.modelling.compose import AgedTexels, anchored
from model_runtime.modelling.measured import anchored_lobes
from model_runtime.modelling.palette import Palette
from model_runtime.modelling.rollout import roll_out
from model_runtime.representation import Trained, load_representation
from model_runtime.representation.latents import Latents
from model_runtime.states import clamped
from model_runtime.temporal.models import LatentLSTM
from model_runtime.temporal.ntm import NeuralTemporalModel

from ...baselines import staf, stt
from ..bench.aging import texels_of
from ..bench.encoders import WEIGHTS, trained_encoder
from ..bench.results import chosen
from .cases import Case
from .sources import RIVALS, SourceModels
from .stage import Stage, as_parameters

__all__ = ("METHODS", "Method", "Models", "Rung", "load_models", "method_for")

METHODS = ("ours", *RIVALS, "stt", "staf", *LADDER)

_SAMPLES = 256
_TOGETHER = 64


class Method(Protocol):
    """One way to continue a first frame, trained on one source."""

    def dear(self, stage: Stage) -> bool:
        """Whether so much is decoded that few frames and pixels are to be scored."""
        ...

    def estimate(self, stage: Stage, frames: list[int], pixels: Tensor) -> Tensor:
        """Radiance [t, E, p, 3] in `frames` at `pixels` [p]."""
        ...


@dataclass(frozen=True)
class Transferred:
    """STT and STAF: a fitted source that makes a whole sequence of a target's maps."""

    model: stt.STTModel | staf.STAFModel

    def dear(self, stage: Stage) -> bool:
        """No."""
        return False

    def estimate(self, stage: Stage, frames: list[int], pixels: Tensor) -> Tensor:
        """All of the target is transferred: STT looks at patches."""
        sequence = self.model.synthesize(stage.initial, stage.case.target.times)
        states = texels_of(sequence).flatten(1, 2)[frames][:, stage.texels[pixels]]
        return stage.sphere.render(clamped(states), pixels)


@dataclass(frozen=True)
class Decoded:
    """An LSTM on latents with nothing added: encoded, rolled out, decoded.

    samples: directions that the encoder reads
    steps: frames that its source had where the target has another number over the same time; the
    rollout is interpolated then.
    """

    representation: Trained
    model: LatentLSTM
    samples: int = _SAMPLES
    steps: int | None = None

    def dear(self, stage: Stage) -> bool:
        """Yes."""
        return True

    def estimate(self, stage: Stage, frames: list[int], pixels: Tensor) -> Tensor:
        """From the latents of the first frame."""
        first = self._encode(stage, 0, pixels)
        flat = self._rolled_out(first, stage.frames)[:, frames]
        return self._render(stage, first, flat, pixels)

    def ceiling(self, stage: Stage, frames: list[int], pixels: Tensor) -> Tensor:
        """From the latents of every frame."""
        each = [self._encode(stage, frame, pixels) for frame in frames]
        flat = torch.stack([latents.flat() for latents in each], 1)
        return self._render(stage, each[0], flat, pixels)

    def fitted(self, stage: Stage, gain: Tensor, pixels: Tensor) -> Tensor:
        """States [T, p, C] of the rollout as textures would hold them: fitted, and anchored to the
        fit of the first frame.
        """
        first = self._encode(stage, 0, pixels)
        flat = self._rolled_out(first, stage.frames)
        fits = [
            fit_torrance_sparrow(self.representation.decode(first.unflat(some), fit_angles()))
            for some in flat.flatten(0, 1).split(_TOGETHER * stage.frames)
        ]
        states = torch.cat([fit.parameters() for fit in fits]).unflatten(0, flat.shape[:2])
        start = stage.start[stage.texels[pixels]]
        return clamped(anchored(states, start, gain).transpose(0, 1))

    def lobed(
        self, stage: Stage, gain: Tensor, frames: list[int], pixels: Tensor, count: int
    ) -> Tensor:
        """Radiance [t, E, p, 3] of the rollout as `age` would show it by `count` lobes: fitted to
        the first frame, followed from frame to frame, and anchored to the former.
        """
        first = self._encode(stage, 0, pixels)
        every = [0, *frames]
        flat = self._rolled_out(first, stage.frames)[:, every]
        seen = [self._decode(first, flat[:, k], views().angles) for k in range(len(every))]

        def given(angles: Tensor) -> Tensor:
            return stage.values(0, pixels, angles)

        fit, measured = LobedFit.of(fit_seen(given)), Measurements.of(given)
        for _ in range(1, count):
            fit = one_more(measured, fit)
        found = following(fit.lobed, seen.__getitem__, len(every), "rgb")
        gain = gain[every]
        states = clamped(anchored(found[..., :WIDTH], fit.states, gain))
        further = found[..., WIDTH:].unflatten(2, (count - 1, FURTHER))
        further = anchored_lobes(fit.further, further, gain)
        shown = torch.cat((states, further.flatten(2)), 2)[:, 1:]
        return stage.sphere.render_decoded(lambda p, a: lobes.evaluate(shown[p], a), pixels)

    def _decode(self, like: Latents, flat: Tensor, angles: Tensor) -> Tensor:
        """f [p, M, 3] of latents [p, D], laid out as `like`."""
        parts = flat.split(_TOGETHER)
        return torch.cat([self.representation.decode(like.unflat(z), angles) for z in parts])

    def _rolled_out(self, first: Latents, frames: int) -> Tensor:
        """Latents [p, frames, D]."""
        steps = self.steps or frames
        flat = self.model.rollout(first.flat(), steps)
        if steps == frames:
            return flat
        place = torch.linspace(0, steps - 1, frames)
        lower = place.long().clamp(0, steps - 2)
        return torch.lerp(flat[:, lower], flat[:, lower + 1], (place - lower)[:, None])

    def _encode(self, stage: Stage, frame: int, pixels: Tensor) -> Latents:
        angles = self.representation.sample_angles(self.samples, measured=stage.measured)
        parts = [
            self.representation.encode(angles, stage.values(frame, some, angles))
            for some in pixels.split(_TOGETHER)
        ]
        return Latents(
            torch.cat([part.color for part in parts]), torch.cat([part.shared for part in parts])
        )

    def _render(self, stage: Stage, like: Latents, flat: Tensor, pixels: Tensor) -> Tensor:
        """Of latents [p, t, D], laid out as `like`."""

        def decode(place: int, angles: Tensor) -> Tensor:
            return self.representation.decode(like.unflat(flat[place]), angles)

        return stage.sphere.render_decoded(decode, pixels)


@dataclass(frozen=True)
class Rung:
    """One rung of a ladder as the product uses it, or (None) the one that it chooses: every texel
    is modeled for itself and anchored to what it was. `samples` as in `roll_out`.
    """

    ntm: NeuralTemporalModel
    representation: Trained
    name: str | None
    samples: int | None = None

    def rung(self, stage: Stage) -> str:
        """`name`, or what `age --temporal-model auto` takes: the ladder's choice, and for a target
        that is mostly unlike the source the affine one.
        """
        if self.name is not None:
            return self.name
        return self.ntm.suited(stage.start)[0]

    def dear(self, stage: Stage) -> bool:
        """Where latents are rolled out."""
        return self.rung(stage) == LSTM_LATENTS

    def estimate(self, stage: Stage, frames: list[int], pixels: Tensor) -> Tensor:
        """What the product would write, rendered; of measured materials, latents as decoded."""
        if stage.measured and self.dear(stage):
            return self.decoded().estimate(stage, frames, pixels)
        return stage.sphere.render(self.states(stage, frames, pixels), pixels)

    def ceiling(self, stage: Stage, frames: list[int], pixels: Tensor) -> Tensor:
        """Of the latents, anchored."""
        if stage.measured:
            return self.decoded().ceiling(stage, frames, pixels)
        start = stage.start[stage.texels[pixels]]
        every = [0, *frames]
        seen = {frame: self._seen(stage, frame, pixels) for frame in dict.fromkeys(every)}
        histories = torch.stack([seen[frame] for frame in every], 1)
        states = anchored(histories, start, self.ntm.affine.gain[every])[:, 1:]
        return stage.sphere.render(clamped(states.transpose(0, 1)), pixels)

    def states(self, stage: Stage, frames: list[int], pixels: Tensor) -> Tensor:
        """[t, p, C], clamped to what can be rendered."""
        rung = self.rung(stage)
        if stage.measured and rung == LSTM_LATENTS:
            return self.decoded().fitted(stage, self.ntm.affine.gain, pixels)[frames]
        aged = self.aged(stage.start[stage.texels[pixels]], rung)
        return torch.stack([aged.at(frame / (stage.frames - 1)) for frame in frames])

    def aged(
        self,
        start: Tensor,
        rung: str,
        *,
        palette: Palette | None = None,
        onset: Tensor | None = None,
        rate: Tensor | None = None,
    ) -> AgedTexels:
        """Texels that start as `start` [n, C], as in `model_runtime.age`: without `onset` [n] all
        change as those of the source did on average.
        """
        palette = palette or Palette(start, torch.arange(len(start)))
        histories = roll_out(
            palette.entries, self.ntm, rung, self.representation, samples=self.samples
        )
        change = Change(self.ntm, rung, self.representation)
        return change.aged(start, palette, histories, onset, rate)

    def decoded(self) -> Decoded:
        """The ladder's last rung, with nothing added."""
        return Decoded(self.representation, self.ntm.latents)

    def _seen(self, stage: Stage, frame: int, pixels: Tensor) -> Tensor:
        """States [p, C] as the representation sees them."""
        angles = self.representation.sample_angles(_SAMPLES)
        latents = self.representation.encode(angles, stage.values(frame, pixels, angles))
        return fit_torrance_sparrow(self.representation.decode(latents, fit_angles())).parameters()


@dataclass(frozen=True)
class Models:
    """The encoders, each with its hash, by method; and what is trained on sources."""

    encoders: dict[str, tuple[Trained, str]]
    sources: SourceModels


def load_models(
    names: Names[str], sources: SourceModels, *, encoder: Path = ENCODER, weights: Path = WEIGHTS
) -> Models:
    """Whatever encoders the methods `names` need: ours from `encoder`, the rivals' from the folder
    `weights`.

    Raises `UsageError` for an unknown method, `ModelFileError` for weights that are missing.
    """
    encoders: dict[str, tuple[Trained, str]] = {}
    for name in chosen("method", names, METHODS):
        if name in RIVALS:
            encoders[name] = load_representation(trained_encoder(name, weights))
        elif name in ("ours", *LADDER) and "ours" not in encoders:
            encoders["ours"] = load_representation(encoder)
    return Models(encoders, sources)


def method_for(name: str, case: Case, models: Models) -> Method:
    """The method `name`, trained on the source of `case`."""
    if name in ("stt", "staf"):
        source = as_parameters(case.source)
        return Transferred(stt.fit(source) if name == "stt" else staf.fit(source))
    representation, encoder = models.encoders[name if name in RIVALS else "ours"]
    args = (case.source_key, case.source, representation, encoder)
    if name in RIVALS:
        return Decoded(representation, models.sources.rival(name, *args))
    return Rung(models.sources.ladder(*args), representation, None if name == "ours" else name)
