"""How each method of the report `realism` ages a clean material after what a source showed.

All are given a material as large as the source, and shown are `size` texels of its side: patterns
and grain have the source's scale.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from model_runtime.brdf import principled
from model_runtime.brdf.fit import fit_angles, fit_torrance_sparrow
from model_runtime.contract import FRAMES, PRINCIPLED, AgeRequest, frame_file
from model_runtime.images import read_image, write_exr
from model_runtime.maps import PrincipledMaps, TorranceSparrowMaps
from model_runtime.modelling.palette import build_palette
from model_runtime.representation import load_representation
from model_runtime.states import rows_of
from model_runtime.temporal.onset import onset_map, rate_map

from ...baselines import stt
from ...data.kinetics import history
from ...data.sequences import Sequence
from ...metric.texture import encoded
from ..bench.aging import age_silently
from ..bench.encoders import WEIGHTS, trained_encoder
from ..synthesis.sources import SourceModels

__all__ = ("METHODS", "Aged", "crossfade", "formula", "ours", "papers", "stt_of")

Array = NDArray[np.float32]

METHODS = ("ours", "ours_v1", "crossfade", "stt", "paper")
"""Those that age; `same_scan` and `other_scan` are scans as they are."""

_SAMPLES = 256  # directions that the paper's encoder reads, as in `evaluate synthesis`
_ENTRIES = 256  # distinct texels that it ages: its decoder takes a second for each
_TOGETHER = 8


@dataclass(frozen=True)
class Aged:
    """Base colors [T, H, W, 3] (sRGB) of a material at T times from 0 to 1, and once all of it has
    weathered for good, `end` [H, W, 3]; heights [T, H, W] in sides of the material where they
    change; the seconds that it took.
    """

    pictures: Array
    end: Array
    heights: Array | None
    seconds: float


def ours(clean: PrincipledMaps, ntm: str, times: int, size: int) -> Aged:
    """What `age` writes with the model `ntm`."""
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        source, output = Path(folder) / "clean", Path(folder) / "aged"
        _write(clean, source)
        request = AgeRequest(source, ntm, output, frames=times, format=PRINCIPLED, binding=FRAMES)
        report = age_silently(request)
        seconds = time.process_time() - start
        pictures, heights = [], []
        for k in range(times):
            color = read_image(output / frame_file("base_color", k), color=True)
            pictures.append(encoded(color[:size, :size]))
            if "height" in report["files"]:
                height = read_image(output / frame_file("height", k), color=False)
                heights.append(height[:size, :size])
        early = Path(folder) / "early.exr"  # so that at the end all is as old as it can be
        write_exr(early, np.zeros(clean.size, np.float32))
        at_once = replace(request, output=Path(folder) / "at_once", frames=2, onset=str(early))
        age_silently(at_once)
        end = read_image(at_once.output / frame_file("base_color", 1), color=True)
    raised = np.stack(heights) if heights else None
    return Aged(np.stack(pictures), encoded(end[:size, :size]), raised, seconds)


def formula(clean: PrincipledMaps, process: str, times: int, size: int) -> Aged:
    """The last release: its models had learned the formulas of `kinetics`, here taken themselves,
    begun as its patterns say.
    """
    start = time.process_time()
    patterns = (make(process, clean.size, seed=0) for make in (onset_map, rate_map))
    onset, rate = (pattern[:size, :size] for pattern in patterns)
    clean = _cropped(clean, size)
    maps = principled.forward(clean)

    def at(age: Array) -> Array:
        aged = TorranceSparrowMaps(*history(process, maps.kd, maps.ks, maps.alpha, age))
        return _shown(aged, clean)

    every = np.linspace(0, 1, times, dtype=np.float32)
    pictures = [at((rate * np.maximum(t - onset, 0)).clip(0, 1)) for t in every]
    seconds = time.process_time() - start
    return Aged(np.stack(pictures), at(np.ones_like(onset)), None, seconds)


def crossfade(clean: PrincipledMaps, end: Array, times: int, size: int) -> Aged:
    """Every texel fades to one color `end` [3], linear."""
    start = time.process_time()
    base = _cropped(clean, size).base_color
    share = np.linspace(0, 1, times, dtype=np.float32)[:, None, None, None]
    pictures = encoded(base + share * (end - base))
    return Aged(pictures, pictures[-1], None, time.process_time() - start)


def stt_of(clean: PrincipledMaps, source: Sequence, times: int, size: int) -> Aged:
    """STT: cubics of the source's texels, carried over by matching patches."""
    start = time.process_time()
    clean = _cropped(clean, size)
    model = stt.fit(source)
    aged = model.synthesize(principled.forward(clean), np.linspace(0, 1, times, dtype=np.float32))
    return _of_sequence(aged, clean, start)


def papers(
    clean: PrincipledMaps, source: Sequence, times: int, size: int, learned: SourceModels, key: str
) -> Aged:
    """The paper's: encoded, rolled out by an LSTM, decoded and fitted. Texels that look alike are
    aged once.
    """
    start = time.process_time()
    clean = _cropped(clean, size)
    representation, identity = load_representation(trained_encoder("paper", WEIGHTS))
    model = learned.rival("paper", key, source, representation, identity)
    states = rows_of(principled.forward(clean))
    palette = build_palette(states, 0.03, most=_ENTRIES)
    steps = len(source.times)
    wanted = np.rint(np.linspace(0, steps - 1, times)).astype(int)
    first = representation.encode_parameters(palette.entries)
    flat = model.rollout(first.flat(), steps)[:, wanted]  # [P, t, D]
    fits = []
    with torch.no_grad():
        for some in flat.flatten(0, 1).split(_TOGETHER):
            f = representation.decode(first.unflat(some), fit_angles())
            fits.append(fit_torrance_sparrow(f).parameters())
    aged = torch.cat(fits).unflatten(0, flat.shape[:2])[palette.index]  # [n, t, C]
    height, width = clean.size
    maps = aged.transpose(0, 1).reshape(times, height, width, -1).numpy()
    return _of_sequence(
        Sequence.of(maps, np.linspace(0, 1, times, dtype=np.float32), key), clean, start
    )


def _of_sequence(sequence: Sequence, clean: PrincipledMaps, start: float) -> Aged:
    aged = sequence.clamped()
    states = zip(aged.kd, aged.ks, aged.alpha, strict=True)
    pictures = np.stack([_shown(TorranceSparrowMaps(*each), clean) for each in states])
    return Aged(pictures, pictures[-1], None, time.process_time() - start)


def _shown(aged: TorranceSparrowMaps, clean: PrincipledMaps) -> Array:
    return encoded(principled.read_back(aged, clean).base_color)


def _cropped(maps: PrincipledMaps, size: int) -> PrincipledMaps:
    return maps.map(lambda pixels: np.ascontiguousarray(pixels[:size, :size]))


def _write(maps: PrincipledMaps, folder: Path) -> None:
    folder.mkdir()
    for name in ("base_color", "metallic", "roughness"):
        write_exr(folder / f"{name}.exr", getattr(maps, name))
