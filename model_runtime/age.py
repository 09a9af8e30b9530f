"""Ageing a material: the pipeline that joins reading, planning, rolling out, fitting and
writing.
"""

from __future__ import annotations

import dataclasses
import shlex
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import torch
from torch import Tensor

from . import __version__
from .brdf.measured import MeasuredBRDF
from .compose import AgedTexels
from .errors import Cancelled, InputError
from .fit import USUAL
from .histories import CPU
from .inputs import hash_file, hash_input, input_files, read_covered, read_input
from .live.files import live_names, write_live
from .live.fitting import Fitted, fit_live
from .maps import PrincipledMaps
from .memory import memory_in_words
from .modelling import EFFORTS, Effort, model_texels
from .package import ENCODER, ESTIMATOR, find_model
from .representation import load_representation
from .representation.estimator import load_estimator
from .result import StagedResult, check_space
from .savings import savings
from .temporal.domain import FOREIGN_SHARE
from .temporal.ntm import NeuralTemporalModel
from .texels import Texels, authored_texels, initial_states, timing_maps
from .writing import Format, Frames, file_names, maps_of, write_frames, write_stored_frames

__all__ = ("AgeRequest", "Reporter", "age")

_LESS_MEMORY = "Choose a smaller size, fewer frames or quality draft."
_BYTES_A_FRAME = 12  # of half-float maps, a texel, compressed or not
_BYTES_A_FILE = 6  # likewise, of three colors
_NOT_LIVE = (
    "This change is too varied for the shader to compute within the tolerance, so frames were "
    "written instead; a lower tolerance may allow it."
)


@dataclass(frozen=True)
class AgeRequest:
    """What to age, how and where to: the options of the command line (docs/design.md)."""

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
    binding: Literal["auto", "live", "frames"] = "frames"
    sparse: bool = False
    seed: int = 0


class Reporter(Protocol):
    """Who hears how a run goes, and may end it."""

    def progress(self, stage: str, fraction: float) -> None: ...

    def warning(self, message: str) -> None: ...

    def cancelled(self) -> bool: ...


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


def age(request: AgeRequest, reporter: Reporter, effort: Effort | None = None) -> dict[str, Any]:
    """Age a material and write its maps; returns the content of `aged.json`.

    `effort` is that of the request's quality unless it is given. Frame 1 is the input. Raises a
    kind of TvbrdfError with a sentence for the user where anything is wrong; the output folder then
    holds what it held before.
    """
    run, effort = _Run(request, reporter), effort or EFFORTS[request.quality]
    # Staged from the beginning: a folder that cannot be written to is found before the work is.
    staging = StagedResult(request.output, compression=effort.compression)
    with (
        memory_in_words(_LESS_MEMORY),
        torch.inference_mode(),
        _one_thread(),
        staging as staged,
    ):
        return _age(run, effort, staged)


@contextmanager
def _one_thread() -> Iterator[None]:
    """One thread for torch: the work is many small steps, which a second thread only slows down."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _age(run: _Run, effort: Effort, staged: StagedResult) -> dict[str, Any]:
    request = run.request
    run.progress("reading", 0.0)
    with run.timed("read"):
        ntm_path = find_model(request.ntm)
        with _unchanged(ntm_path, ENCODER, ESTIMATOR):
            representation, identity = load_representation()
            estimator = load_estimator(identity)
            ntm = NeuralTemporalModel.load(ntm_path, identity)
            hashes: dict[str, Any] = {
                "ntm": hash_file(ntm_path),
                "encoder": hash_file(ENCODER),
                "estimator": hash_file(ESTIMATOR),
            }
        for doubt in ntm.warnings:
            run.warn(f"Of what {ntm.card.title} was learned from: {doubt}")
        with _unchanged(*input_files(request.input)):
            material = read_input(request.input, size=request.size)
            hashes["input"] = hash_input(request.input)
            maps_size = (1, 1) if isinstance(material, MeasuredBRDF) else material.size
            covered = read_covered(request.input, maps_size)
        initial, size, fit_error = initial_states(material, request)
    with run.timed("onset"):
        onset, rate = timing_maps(request, ntm, size)
    if onset is not None and size == (1, 1):
        size = onset.shape[0], onset.shape[1]
        initial = initial.expand(size[0] * size[1], 7)
    wanted = request.format or (
        "principled" if isinstance(material, PrincipledMaps) else "torrance-sparrow"
    )
    live_wanted = request.binding != "frames" and size != (1, 1)
    pixels = size[0] * size[1]

    def check_room(*, live: bool) -> None:
        names = live_names() if live else file_names(wanted, request.frames)
        staged.require_free(names)
        needed = len(names) * _BYTES_A_FILE if live else request.frames * _BYTES_A_FRAME
        check_space(request.output, pixels * needed, len(names))

    check_room(live=live_wanted)
    texels = Texels.of(initial, onset, rate)
    counted = texels if covered is None else texels.where(covered)
    rung = _rung(run, ntm, counted.initial)
    model = partial(
        model_texels,
        ntm=ntm,
        rung=rung,
        representation=representation,
        estimator=estimator,
        tolerance=request.tolerance,
        specular=request.specular,
        measured=material if isinstance(material, MeasuredBRDF) else None,
        device=_device(),
        warn=run.warn,
    )
    with run.timed("model"):
        modelled = model(
            counted.initial,
            effort=effort,
            onset=counted.onset,
            rate=counted.rate,
            step=lambda share: run.progress("modelling the change", 0.05 + 0.35 * share),
        )

    def each_for_itself(some: Tensor) -> AgedTexels:
        fit = (effort.fit or USUAL) if effort.checked else effort.fit
        own = replace(effort, step=0.0, checked=False, fit=fit)
        return model(some, effort=own, onset=None if onset is None else torch.zeros(len(some)))

    live: Fitted | None = None
    if live_wanted:
        with run.timed("fit"):
            run.progress("finding what texels share", 0.4)
            authored = None
            if wanted == "principled" and isinstance(material, PrincipledMaps):
                authored = authored_texels(material, size, covered)
            live = fit_live(modelled, request.tolerance, each_for_itself, authored)
        if live is None:
            if request.binding == "live":
                run.warn(_NOT_LIVE)
            check_room(live=False)
    times = np.linspace(0, 1, request.frames).tolist()
    with run.timed("write"):
        run.progress("writing", 0.4)
        aged = modelled if covered is None else texels.beside(modelled, covered)
        if live is not None:
            format, files = write_live(live.sum, aged, size, wanted, staged)
        else:
            maps = maps_of(aged, material, size, wanted, times, covered=covered)
            format, files = maps.format, _write(run, Frames(maps, times, effort.interval), staged)
        if format != wanted:
            run.warn(
                "Some texels reflect more than the exact Principled mapping can hold (Ks above "
                "0.8, or base colour above 1), so Torrance-Sparrow maps were written."
            )
        staged.finish()
    report = {
        "format": format,
        "binding": "frames" if live is None else "live",
        "coefficients": 0 if live is None else live.coefficients,
        "ntm": ntm.card.name,
        "frames": request.frames,
        "times": [round(time, 6) for time in times],
        "size": list(size),
        "quality": request.quality,
        "temporal_model": rung,
        "palette": len(modelled.palette.entries),
        "plan": savings(
            texels=len(counted.initial),
            modelled=len(modelled.palette.entries),
            interval=effort.interval,
            files=files,
            coefficients=None if live is None else live.coefficients,
            not_live=live_wanted and live is None,
        ),
        "fit_error": round(max(fit_error, modelled.histories.fit_error), 6),
        **({} if live is None else {"error_db": live.error_db}),
        "warnings": run.warnings,
        "seconds": run.seconds,
        "peak_rss_mb": _peak_rss_mb(),
        "files": files,
        "version": __version__,
        "command": command_line(request),
        "seed": request.seed,
        "onset": request.onset,
        "tolerance": request.tolerance,
        "hashes": hashes,
    }
    staged.commit(report)
    return report


def _write(run: _Run, frames: Frames, staged: StagedResult) -> dict[str, Any]:
    """Write all frames, or those that are stored; returns `files` of `aged.json`."""
    request = run.request

    def step(fraction: float) -> None:
        run.progress("writing", 0.4 + 0.6 * fraction)

    if request.sparse:
        return write_stored_frames(
            frames, staged, step, tolerance=request.tolerance, seed=request.seed
        )
    return write_frames(frames, staged, step)


@contextmanager
def _unchanged(*files: Path) -> Iterator[None]:
    """Raise InputError where one of `files` is replaced or changed within the block.

    What was read and what was hashed would be two things.
    """
    before = [_version(file) for file in files]
    yield
    for file, version in zip(files, before, strict=True):
        if _version(file) != version:
            raise InputError(f"{file} changed while it was read.", "Run it again.")


def _version(file: Path) -> tuple[int, ...] | None:
    """What differs between two versions of a file; None where there is none."""
    try:
        status = file.stat()
    except OSError:
        return None
    return status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns


def _rung(run: _Run, ntm: NeuralTemporalModel, initial: Tensor) -> str:
    """The model of change to use: what was asked for, or what suits the material."""
    if run.request.temporal_model != "auto":
        return run.request.temporal_model
    rung, share = ntm.suited(initial)
    if rung == "affine" and share > FOREIGN_SHARE:
        run.warn(
            f"{share:.0%} of this material is unlike anything {ntm.card.title} was trained on; "
            "a plain affine change is used. Choose a temporal model yourself to override this."
        )
    return rung


def _device() -> torch.device:
    """CUDA's where there is one. Apple's GPUs are not used: the fit needs double precision."""
    return torch.device("cuda") if torch.cuda.is_available() else CPU


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
    # Linux counts in ru_maxrss what the parent held when it started this process.
    status = Path("/proc/self/status")
    if status.exists():
        held = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return round(int(held["VmHWM"].split()[0]) / (1 << 10), 1)
    try:
        import resource
    except ImportError:  # Windows
        return None
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 20), 1)
