"""Ageing a material: the pipeline that joins reading, planning, rolling out, fitting and
writing.
"""

from __future__ import annotations

import dataclasses
import math
import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import torch
from torch import Tensor

from . import __version__
from .brdf import principled
from .brdf.measured import MeasuredBRDF
from .compose import AgedTexels
from .errors import Cancelled, InputError
from .histories import Histories, fit_measured, roll_out
from .images import Compression, read_image, resize
from .inputs import Material, hash_file, hash_input, read_input
from .maps import PrincipledMaps, TorranceSparrowMaps
from .onset import onset_map, rate_map
from .package import ENCODER, find_model
from .plan import Palette, appearance_psnr, build_palette
from .representation import load_representation
from .representation.latents import Representation
from .result import StagedResult, check_space
from .temporal.domain import FOREIGN_SHARE
from .temporal.ntm import NeuralTemporalModel
from .writing import Format, maps_of, write_frames, write_stored_frames

__all__ = ("AgeRequest", "Reporter", "age")

_UNIFORM_SIZE = 512
_WORTHWHILE = 1.0  # dB that finer cells must gain to be made finer still
_CHECKED = 128  # texels on which a palette is compared with each modelled for itself
_BYTES_PER_TEXEL = 12  # of a frame's half-float maps, compressed or not


@dataclass(frozen=True)
class AgeRequest:
    """What to age, how and where to; the fields are the options of the command line (DESIGN.md)."""

    input: Path
    ntm: str
    output: Path
    frames: int = 36
    size: int | None = None
    quality: Literal["draft", "balanced", "exact"] = "balanced"
    tolerance: float = 45.0
    temporal_model: str = "auto"
    onset: str = "auto"
    specular: Literal["rgb", "mono"] = "rgb"
    format: Format | None = None
    sparse: bool = False
    seed: int = 0


class Reporter(Protocol):
    """Who hears how a run goes, and may end it."""

    def progress(self, stage: str, fraction: float) -> None: ...

    def warning(self, message: str) -> None: ...

    def cancelled(self) -> bool: ...


@dataclass(frozen=True)
class _Effort:
    """What a quality means: width of a palette's cells, most entries, samples for the encoder where
    it is not to take a short cut from the parameters, and what is spent on making files small.
    """

    step: float
    most: int
    samples: int | None
    compression: Compression


_EFFORTS = {
    "draft": _Effort(step=0.12, most=256, samples=None, compression="none"),
    "balanced": _Effort(step=0.05, most=2048, samples=None, compression="zip"),
    "exact": _Effort(step=0.0, most=0, samples=16_200, compression="zip"),
}


@dataclass
class _Run:
    """One run's request, listener, clock and what it has to say at the end."""

    request: AgeRequest
    reporter: Reporter
    warnings: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    def warn(self, message: str) -> None:
        self.warnings.append(message)
        self.reporter.warning(message)

    def progress(self, stage: str, fraction: float) -> None:
        """Tell how far the whole run is, 0 to 1; raises Cancelled where the user asked for it."""
        if self.reporter.cancelled():
            raise Cancelled
        self.reporter.progress(stage, fraction)

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[stage] = round(time.perf_counter() - start, 3)


def age(request: AgeRequest, reporter: Reporter) -> dict[str, Any]:
    """Age a material and write its maps; returns the content of `aged.json`.

    Frame 1 is the input. Raises a kind of TvbrdfError with a sentence for the user where anything
    is wrong; the output folder then holds what it held before.
    """
    run = _Run(request, reporter)
    with torch.inference_mode(), _one_thread():
        return _age(run)


@contextmanager
def _one_thread() -> Iterator[None]:
    """One thread for torch: the work is many small steps, which a second thread only slows down."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _age(run: _Run) -> dict[str, Any]:
    request = run.request
    run.progress("reading", 0.0)
    with run.timed("read"):
        ntm_path = find_model(request.ntm)
        representation, identity = load_representation()
        ntm = NeuralTemporalModel.load(ntm_path, identity)
        for doubt in ntm.warnings:
            run.warn(f"Of what {ntm.card.title} was learned from: {doubt}")
        material = read_input(request.input, size=request.size)
        initial, size, fit_error = _initial(material, request)
    with run.timed("onset"):
        onset, rate = _timing(request, ntm, size)
    if onset is not None and size == (1, 1):
        size = onset.shape[0], onset.shape[1]
        initial = initial.expand(size[0] * size[1], 7)
    check_space(request.output, size[0] * size[1] * request.frames * _BYTES_PER_TEXEL)
    with run.timed("model"):
        rung = _rung(run, ntm, initial)
        gain = torch.ones_like(ntm.affine.gain) if rung == "constant" else ntm.affine.gain
        palette, histories = _model(run, initial, ntm, rung, gain, representation, material)
    aged = AgedTexels(
        initial,
        palette,
        histories,
        gain,
        None if onset is None else torch.from_numpy(onset.reshape(-1)),
        None if rate is None else torch.from_numpy(rate.reshape(-1)),
    )
    if onset is None and ntm.timing is not None:
        aged = aged.averaged(torch.from_numpy(ntm.timing.mean_of_ages(ntm.frames)))
    times = np.linspace(0, 1, request.frames).tolist()
    wanted = request.format or (
        "principled" if isinstance(material, PrincipledMaps) else "torrance-sparrow"
    )
    compression = _EFFORTS[request.quality].compression
    with StagedResult(request.output, compression=compression) as staged:
        with run.timed("write"):
            maps = maps_of(aged, material, size, wanted, times)
            if maps.format != wanted:
                run.warn(
                    "Some texels reflect more than the exact Principled mapping can hold (Ks above "
                    "0.8, or base colour above 1), so Torrance-Sparrow maps were written."
                )

            def step(fraction: float) -> None:
                run.progress("writing", 0.4 + 0.6 * fraction)

            files: dict[str, Any]
            if request.sparse:
                files = write_stored_frames(
                    maps, staged, times, step, tolerance=request.tolerance, seed=request.seed
                )
            else:
                files = write_frames(maps, staged, times, step)
            staged.finish()
        report = {
            "format": maps.format,
            "ntm": ntm.card.name,
            "frames": request.frames,
            "times": [round(time, 6) for time in times],
            "size": list(size),
            "quality": request.quality,
            "temporal_model": rung,
            "palette": len(palette.entries),
            "fit_error": round(max(fit_error, histories.fit_error), 6),
            "warnings": run.warnings,
            "seconds": run.seconds,
            "peak_rss_mb": _peak_rss_mb(),
            "files": files,
            "version": __version__,
            "command": command_line(request),
            "seed": request.seed,
            "onset": request.onset,
            "tolerance": request.tolerance,
            "hashes": {
                "input": hash_input(request.input),
                "ntm": hash_file(ntm_path),
                "encoder": hash_file(ENCODER),
            },
        }
        staged.commit(report)
    return report


def _initial(material: Material, request: AgeRequest) -> tuple[Tensor, tuple[int, int], float]:
    """Parameters [n, 7] of every texel at t = 0, the size in texels, and the error of the fit."""
    if isinstance(material, MeasuredBRDF):
        parameters, error = fit_measured(material, request.specular)
        return parameters, (1, 1), error
    maps = principled.forward(material) if isinstance(material, PrincipledMaps) else material
    ks = maps.ks
    if request.specular == "mono" and isinstance(material, TorranceSparrowMaps):
        ks = np.repeat(ks.mean(-1, keepdims=True), 3, -1)
    flat = np.concatenate((maps.kd, ks, maps.alpha[..., None]), -1, dtype=np.float32)
    return torch.from_numpy(flat.reshape(-1, 7)), maps.size, 0.0


def _timing(
    request: AgeRequest, ntm: NeuralTemporalModel, size: tuple[int, int]
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """When each texel's history starts, 0 to 1, and how fast it runs: [H, W] each.

    An image says only when: its rate is None, which stands for 1. Without any (both None) all
    texels change alike, as those of the source did on average; so they do in a pattern after a
    source that changed everywhere at once.
    """
    timing, process, seed = ntm.timing, ntm.card.process, request.seed
    at_once = timing is not None and timing.at_once
    if request.onset == "none" or (request.onset == "auto" and at_once):
        return None, None
    if request.onset == "auto":
        side = request.size or _UNIFORM_SIZE
        shape = (side, side) if size == (1, 1) else size
        return (
            onset_map(process, shape, seed=seed, timing=timing),
            rate_map(process, shape, seed=seed, timing=timing),
        )
    onset = read_image(Path(request.onset), color=False)
    if not (np.isfinite(onset).all() and onset.min() >= 0 and onset.max() <= 1):
        raise InputError(
            f"The onset image {request.onset} has values outside 0 to 1.",
            "Paint 0 where the change starts at once and 1 where it never starts.",
        )
    if size == (1, 1):
        scale = (request.size or max(onset.shape)) / max(onset.shape)
        height, width = (max(1, round(length * scale)) for length in onset.shape)
        size = (height, width)
    return resize(onset, size), None


def _rung(run: _Run, ntm: NeuralTemporalModel, initial: Tensor) -> str:
    """The model of change to use: what was asked for, or the NTM's own choice within its domain.

    Most of a material lying far from everything the NTM was trained on, its LSTMs would extrapolate
    in silence; the affine rung cannot run away, and says so.
    """
    if run.request.temporal_model != "auto":
        return run.request.temporal_model
    sample = initial[:: max(1, len(initial) // 4096)]
    share = float(ntm.domain.outside(sample).float().mean())
    if share > FOREIGN_SHARE and ntm.chosen != "constant":
        run.warn(
            f"{share:.0%} of this material is unlike anything {ntm.card.title} was trained on; "
            "a plain affine change is used. Choose a temporal model yourself to override this."
        )
        return "affine"
    return ntm.chosen


def _model(
    run: _Run,
    initial: Tensor,
    ntm: NeuralTemporalModel,
    rung: str,
    gain: Tensor,
    representation: Representation,
    material: Material,
) -> tuple[Palette, Histories]:
    """A palette of the texels and its histories, as fine as the tolerance needs.

    A few texels are also modelled each for itself; where the palette misses them by more than the
    tolerance, its cells are halved as long as that helps, and what is still missing is said. A
    draft is not checked.
    """
    effort = _EFFORTS[run.request.quality]
    options = {
        "samples": effort.samples,
        "specular": run.request.specular,
        "measured": material if isinstance(material, MeasuredBRDF) else None,
    }

    def step(fraction: float) -> None:
        run.progress("modelling the change", 0.05 + 0.35 * fraction)

    def modelled(palette: Palette) -> Histories:
        return roll_out(palette.entries, ntm, rung, representation, step=step, **options)

    if bool((initial == initial[0]).all()):
        palette = Palette(initial[:1].clone(), torch.zeros(len(initial), dtype=torch.long))
        return palette, modelled(palette)
    palette = build_palette(initial, effort.step, most=effort.most)
    histories = modelled(palette)
    if run.request.quality != "balanced":
        return palette, histories
    rows = torch.linspace(0, len(initial) - 1, min(_CHECKED, len(initial))).long()
    own = Palette(initial[rows], torch.arange(len(rows)))
    truth = AgedTexels(own.entries, own, modelled(own), gain, None)

    def reached() -> float:
        shared = Palette(palette.entries, palette.index[rows])
        estimate = AgedTexels(own.entries, shared, histories, gain, None)
        return min(appearance_psnr(truth.at(t), estimate.at(t)) for t in (0.1, 0.3, 0.6, 1.0))

    psnr, gained, cells = reached(), math.inf, effort.step
    while psnr < run.request.tolerance and gained > _WORTHWHILE:
        cells /= 2
        finer = build_palette(initial, cells, most=effort.most)
        if len(finer.entries) <= len(palette.entries):
            break
        palette, histories = finer, modelled(finer)
        before, psnr = psnr, reached()
        gained = psnr - before
    if psnr < run.request.tolerance:
        run.warn(
            f"Modelling few materials reaches {psnr:.0f} of the {run.request.tolerance:g} dB asked "
            "for; choose quality exact to model every texel."
        )
    return palette, histories


def command_line(request: AgeRequest) -> str:
    """The command that does the same again."""
    words = ["python", "-m", "model_runtime", "age"]
    for item in dataclasses.fields(request):
        value = getattr(request, item.name)
        if value is True:
            words.append(f"--{item.name}")
        elif value is not None and value is not False:
            words += [f"--{item.name.replace('_', '-')}", str(value)]
    return shlex.join(words)


def _peak_rss_mb() -> float | None:
    """The most memory this process has held so far, in MB; None where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (1 << 20 if sys.platform == "darwin" else 1 << 10), 1)
