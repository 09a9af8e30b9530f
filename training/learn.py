"""From a weathered material to a model of how it weathers, in one step: `python -m training learn`.

Imports only what ships with the extension, so that it also runs inside Blender's worker.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from model_runtime.atomic import check_writable
from model_runtime.errors import shown
from model_runtime.model_files.weights import ENCODER

from .data.sequences import MixtureSequence, Sequence, read_sequence
from .loop import Run
from .ntm import PARTS, NTMConfig, check_texts, write_ntm
from .source.change import Change, kept_by, sequence_of
from .source.onsets import timed
from .source.pictures import is_timelapse
from .source.scan import change_of, read_states
from .source.scan_maps import ScanMaps
from .source.steadiness import steadied
from .source.timelapse import change_of_timelapse, read_timelapse

__all__ = ("LEARNING", "learn", "read_change")

LEARNING = NTMConfig(iterations=250, batch=128, warm_up=20)
"""LSTMs of a history that is affine by construction: the cheaper rung suffices for it."""

_SEEN = 0.15  # share of the work that is done once the source has been seen
_SHARES = {"parameters": (0.15, 0.5), "latents": (0.5, 0.95)}

Step = Callable[[str, float], None]


def _quiet(stage: str, fraction: float) -> None:
    pass


def learn(
    source: Path | ScanMaps | Sequence,
    output: Path,
    name: str,
    *,
    process: str = "",
    title: str = "",
    description: str = "",
    mask: Path | None = None,
    sources: tuple[Mapping[str, str], ...] = (),
    license: str = "",
    minutes: float | None = None,
    seed: int = 0,
    encoder: Path = ENCODER,
    step: Step = _quiet,
    command: str = "",
) -> dict[str, Any]:
    """Learn a neural temporal model from what weathered and write it to `output`; its card.

    source: a folder of texture maps or an image that is clean in places and weathered in others
        (or such maps, a crop of them too); a time-lapse; a folder that holds a sequence, or one
    process: how it grows, and which other materials may take the same way
    sources: name, license and credit of each work that it is learned from
    minutes: of a core that the LSTMs may take
    step: hears the stage and which share of the whole is done, and may end it by raising

    Raises InputError where there is nothing to learn, with a sentence that says why.
    """
    check_writable(output)
    card = {
        "name": name,
        "title": title or name.replace("_", " ").capitalize(),
        "description": description,
        "process": process or name,
        "license": license,
    }
    check_texts(card)
    step("Looking at what weathered", 0.0)
    sequence, told = _sequence(source, mask, process, sources, seed)
    step("Learning", _SEEN)

    def watch(part: str, fraction: float) -> None:
        first, last = _SHARES.get(part.rpartition(".")[2], (_SEEN, 0.95))
        step("Learning", first + (last - first) * fraction)

    run = Run(output, minutes=minutes, seed=seed, watch=watch)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # steps this small only wait for each other
    try:
        details = write_ntm(
            sequence, encoder, {**card, "source": " ".join(told)}, command, LEARNING, run
        )
    finally:
        torch.set_num_threads(threads)
        for part in PARTS:  # what was interrupted is quicker to do again than to resume
            run.part(part).checkpoint.unlink(missing_ok=True)
    step("Learning", 1.0)
    return details


def read_change(
    source: Path | ScanMaps, *, mask: Path | None = None, process: str = "", seed: int = 0
) -> Change:
    """What a scan or a time-lapse shows of a change."""
    if isinstance(source, Path) and is_timelapse(source):
        return change_of_timelapse(read_timelapse(source), process=process, seed=seed)
    return change_of(read_states(source, mask=mask, process=process), seed=seed)


def _sequence(
    source: Path | ScanMaps | Sequence,
    mask: Path | None,
    process: str,
    sources: tuple[Mapping[str, str], ...],
    seed: int,
) -> tuple[Sequence | MixtureSequence, tuple[str, ...]]:
    """A sequence whose timing is known, and sentences about where it comes from."""
    if isinstance(source, Path) and _holds_sequence(source):
        source = read_sequence(source, clamp=False)  # type: ignore[assignment]
    if isinstance(source, Sequence | MixtureSequence):
        learned = timed(steadied(source), seed=seed)
        if sources and isinstance(learned, Sequence):
            learned = replace(learned, sources=sources)
        return learned, (f"Learned from the sequence {shown(source.name)}.",)
    change = read_change(source, mask=mask, process=process, seed=seed)
    learned = sequence_of(change, process=process, sources=sources, seed=seed)
    kept = kept_by(process)
    told = [f"Learned from {shown(change.name)}.", *change.told]
    if kept:
        told.append(f"{kept:.0%} of a material's own differences were assumed to outlive it.")
    return learned, tuple(told)


def _holds_sequence(path: Path) -> bool:
    """Whether a folder holds frames, polynomials or mixtures rather than texture maps."""
    return path.is_dir() and any(
        (path / name).exists() for name in ("kd_0001.exr", "Diffuse-0.exr", "mixture.json")
    )
