"""The grain and the relief of a model, from the sequence that it learned from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from model_runtime.atomic import check_writable
from model_runtime.errors import InputError, shown
from model_runtime.model_files.weights import read_card, save_model
from model_runtime.temporal.ntm import NeuralTemporalModel

from .data.sequences import MixtureSequence, Sequence, read_sequence
from .source.grain import grain_of_sequence, height_of
from .source.onsets import timed
from .source.residue import with_residue
from .source.steadiness import steadied

__all__ = ("give_grain", "grained")


def grained(
    ntm: NeuralTemporalModel, sequence: Sequence | MixtureSequence, *, seed: int = 0
) -> tuple[NeuralTemporalModel, Mapping[str, Any]]:
    """`ntm` with the grain and height of `sequence`, whose timing is known, and what a card says of
    them and of whose work the sequence was made from; as it is after a mixture, which has neither.
    """
    if isinstance(sequence, MixtureSequence):
        return ntm, {}
    sequence = with_residue(sequence, seed=seed)
    ntm = replace(ntm, grain=grain_of_sequence(sequence), height=height_of(sequence))
    told: dict[str, Any] = {}
    if ntm.grain is not None:
        told["grain"] = {"share": round(ntm.grain.share, 4)}
    if sequence.sources:
        told["sources"] = [dict(source) for source in sequence.sources]
    return ntm, told


def give_grain(*, sequence: Path, model: Path, output: Path, seed: int = 0) -> Path:
    """Write `model` to `output` with the grain and height of `sequence`; its networks, and all else
    that they learned, stay. Returns that path.

    Raises InputError where the sequence has neither.
    """
    check_writable(output)
    card = read_card(model)
    learned = timed(steadied(read_sequence(sequence, clamp=False)), seed=seed)
    ntm, told = grained(NeuralTemporalModel.load(model, card.representation), learned, seed=seed)
    if ntm.grain is None and ntm.height is None:
        raise InputError(
            f"The sequence {shown(sequence)} has neither grain nor height.",
            "Give one that holds grain_kd.exr and the like, or is a picture.",
        )
    command = (
        f"python -m training grain --sequence {shown(sequence)} --model {shown(model.name)} "
        f"--output {shown(output.name)} --seed {seed}"
    )
    details = {**card.details, **told, "trained": {**card.trained, "grain": command}}
    save_model(
        output,
        ntm.tensors(),
        details,
        kind="ntm",
        check=lambda file: NeuralTemporalModel.load(file, card.representation),
    )
    return output
