"""What the methods of the report `synthesis` learn from a source: kept, so learned once."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
from safetensors.torch import load_file
from torch import Tensor

from model_runtime.model_files.weights import read_card, save_model
from model_runtime.representation import Trained
from model_runtime.temporal.models import LatentLSTM
from model_runtime.temporal.ntm import NeuralTemporalModel

from ...data.sequences import MixtureSequence, Sequence
from ...loop import Run, remove_checkpoints
from ...ntm import PARTS, NTMConfig, train_ladder, train_lstm
from ...source.histories import source_histories
from ...source.onsets import timed
from ...source.steadiness import steadied
from ..bench.aging import texels_of
from ..bench.kept import code, identity, kept
from .stage import thinned

__all__ = ("RIVALS", "Effort", "SourceModels", "describe")

RIVALS = ("paper", "brdfnps")
"""Methods with an encoder of their own, on whose latents the paper's LSTM is trained."""

AnySequence = Sequence | MixtureSequence


@dataclass(frozen=True)
class Effort:
    """How much is spent on a source: texels and iterations of the product's ladder, and of the
    paper's LSTM, whose encoder takes 6 ms for a texel and frame.
    """

    ladder: NTMConfig = field(default_factory=lambda: NTMConfig(iterations=400, batch=128))
    texels: int = 1024
    rival: NTMConfig = field(default_factory=lambda: NTMConfig(iterations=600, batch=128))
    rival_texels: int = 128


def describe(sequence: AnySequence) -> str:
    """What identifies a sequence."""
    if isinstance(sequence, MixtureSequence):
        return identity(",".join(sequence.materials), torch.from_numpy(sequence.weights))
    parts = [str(sequence.timing), texels_of(sequence), torch.from_numpy(sequence.times)]
    parts += [] if sequence.onset is None else [torch.from_numpy(sequence.onset)]
    return identity(*parts)


@dataclass(frozen=True)
class SourceModels:
    """Models of change trained on sources; what has been trained is in `folder`, and survives
    being killed at any moment. `save_every` as in `Run`.
    """

    folder: Path
    effort: Effort
    save_every: float = 60.0

    def minutes(self) -> dict[str, float]:
        """How long one training took, by method: the mean over all that is kept."""
        found: dict[str, list[float]] = defaultdict(list)
        for path in self.folder.glob("ntm_*.safetensors"):
            found["ours"].append(read_card(path).trained["minutes"])
        for name in RIVALS:
            for path in self.folder.glob(f"{name}_*.safetensors"):
                found[name].append(float(load_file(path)["minutes"]))
        return {name: round(sum(each) / len(each), 3) for name, each in found.items()}

    def ladder(
        self,
        key: str,
        source: AnySequence,
        representation: Trained,
        encoder: str,
        *,
        onset: bool = True,
    ) -> NeuralTemporalModel:
        """All rungs, as `python -m training ntm` would train them on the texels of `source`; its
        onset, where it has one, is known to them unless `onset` is False: then it is estimated.
        `encoder` is the hash of the representation.
        """
        effort = self.effort
        chosen = steadied(source if onset else _without_onset(source))
        spent = f"{effort.ladder} {effort.texels} {code()}"
        made_from = identity(describe(chosen), encoder, spent)
        path = self.folder / f"ntm_{key}{'' if onset else '_estimated'}.safetensors"
        if not path.exists() or read_card(path).details.get("made_from") != made_from:
            histories = source_histories(thinned(timed(chosen), effort.texels), representation)
            run = self._run(path, made_from)
            ntm = train_ladder(histories, representation, effort.ladder, run)
            card = {"name": key, "title": key, "frames": ntm.frames, "representation": encoder}
            details = {**card, **ntm.card.details, "made_from": made_from, "source": "evaluation"}
            save_model(path, ntm.tensors(), details, kind="ntm")
            remove_checkpoints(run, PARTS)
        return NeuralTemporalModel.load(path, encoder)

    def rival(
        self, name: str, key: str, source: AnySequence, representation: Trained, encoder: str
    ) -> LatentLSTM:
        """The paper's temporal model on the latents of one of its encoders."""
        effort = self.effort
        spent = f"{effort.rival} {effort.rival_texels} {code()}"
        made_from = identity(describe(source), encoder, spent)
        path = self.folder / f"{name}_{key}.safetensors"

        def make() -> dict[str, Tensor]:
            few = thinned(_without_onset(source), effort.rival_texels)
            histories, run = source_histories(few, representation), self._run(path, made_from)
            model, record = train_lstm("latents", histories, representation, effort.rival, run)
            remove_checkpoints(run, PARTS)
            return {**model.state_dict(), "minutes": torch.tensor(record["seconds"] / 60)}

        stored = kept(path, made_from, make)
        del stored["minutes"]
        model = LatentLSTM(*representation.latent_sizes)
        model.load_state_dict(stored)
        return model.eval().requires_grad_(False)

    def _run(self, path: Path, made_from: str) -> Run:
        base = path.with_name(f"{path.stem}_{made_from[:8]}")
        return Run(base, resume=True, save_every=self.save_every)


def _without_onset(source: AnySequence) -> AnySequence:
    if isinstance(source, MixtureSequence):
        return source
    return replace(source, onset=None, timing=None)
