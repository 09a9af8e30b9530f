"""The product under stress: the real `age`, on files, and whether it says what is wrong."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import OpenEXR
import torch
from torch import Tensor

from model_runtime.age import AgeRequest
from model_runtime.contract import BALANCED, EVERYWHERE, TORRANCE_SPARROW, frame_file
from model_runtime.errors import TvbrdfError
from model_runtime.images import read_image
from model_runtime.maps import TorranceSparrowMaps
from model_runtime.modelling.aged import EFFORTS, Effort
from model_runtime.request import request_from
from model_runtime.states import rows_of

from ..bench.aging import age_silently
from .trials import Trial

__all__ = ("Aged", "age_trial", "read_states")

_MAPS = ("kd", "ks", "alpha")


@dataclass(frozen=True)
class Aged:
    """`states` [t, H W, C] of the frames that a trial scores, None where the product refused; and
    all that it said.
    """

    states: Tensor | None
    said: tuple[str, ...]


def age_trial(trial: Trial, given: TorranceSparrowMaps, ntm: Path) -> Aged:
    """What `age` makes of the maps `given` with the model file `ntm`, all else as by default but
    the onset: none, as in the truth.

    A target longer than the source is asked for, which is refused; its states are then those at
    the end of what can be asked for.
    """
    said: list[str] = []
    frames = len(trial.case.target.times)
    wanted = trial.frames
    with tempfile.TemporaryDirectory() as folder:
        source, output = Path(folder) / "input", Path(folder) / "output"
        _write(given, source)
        if trial.span > 1:
            said.append(_refused_duration(source, ntm, output, trial.span))
            length = len(trial.case.source.times)
            wanted = [min(frame, length - 1) for frame in wanted]
            frames = length
        request = AgeRequest(
            source, str(ntm), output, frames=frames, onset=EVERYWHERE, format=TORRANCE_SPARROW
        )
        try:
            said += age_silently(request, _effort(trial))["warnings"]
        except TvbrdfError as error:
            return Aged(None, (*said, str(error)))
        states = torch.stack([read_states(output, frame + 1) for frame in wanted])
    return Aged(states, tuple(said))


def _refused_duration(source: Path, ntm: Path, output: Path, span: float) -> str:
    """What the product answers to a wish for a history `span` times as long; nothing where it is
    granted.
    """
    wish = {"input": str(source), "ntm": str(ntm), "output": str(output), "duration": span}
    try:
        request_from(wish)
    except TvbrdfError as error:
        return str(error)
    return ""


def _effort(trial: Trial) -> Effort:
    """`balanced` with fewer entries in its palette, or fewer samples for its encoder, than a user
    can ask for.
    """
    turned = {"most": trial.palette, "samples": trial.samples}
    return replace(
        EFFORTS[BALANCED], **{name: value for name, value in turned.items() if value is not None}
    )


def _write(maps: TorranceSparrowMaps, folder: Path) -> None:
    """The input as single floats: `write_exr` would round, and clamp what is infinite."""
    folder.mkdir()
    for name in _MAPS:
        pixels = getattr(maps, name)
        planes = [pixels] if pixels.ndim == 2 else np.moveaxis(pixels, -1, 0)
        channels = {
            channel: np.ascontiguousarray(plane)
            for channel, plane in zip("Y" if len(planes) == 1 else "RGB", planes, strict=True)
        }
        header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, channels).write(str(folder / f"{name}.exr"))


def read_states(folder: Path, number: int) -> Tensor:
    """States [H W, C] of a frame, counted from 1."""
    files = ((name, folder / frame_file(name, number - 1)) for name in _MAPS)
    maps = TorranceSparrowMaps(*(read_image(file, color=name != "alpha") for name, file in files))
    return rows_of(maps)
