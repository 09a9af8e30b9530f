"""Aging a material: the pipeline that joins reading, planning, rolling out, fitting and
writing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from .account import account_of
from .backend import Tensor, torch, version
from .brdf.measured import MeasuredBRDF
from .brdf.refinement import DOUBTFUL
from .contract import AFFINE, AUTO, LIVE, LSTM_LATENTS, PRINCIPLED, AgeRequest, Format
from .device import device_of
from .errors import InputError
from .live.files import live_names, write_live
from .live.fitting import Fitted, fit_live
from .maps import PrincipledMaps
from .memory import memory_in_words
from .modelling.aged import EFFORTS, Change, Effort, model_texels
from .modelling.compose import AgedTexels
from .modelling.start import Start, read_start
from .modelling.texels import authored_texels
from .output.frames import Frames, file_names, maps_of, write_frames, write_stored_frames
from .output.stored import StagedResult, check_space
from .representation.measured import Encoded, encode_measured
from .run import Reporter, Run
from .temporal.domain import FOREIGN_SHARE

__all__ = ("AgeRequest", "Reporter", "age", "computes")

_LESS_MEMORY = "Choose a smaller size, fewer frames or quality draft."
_BYTES_A_FRAME = 12  # of half-float maps, a texel, compressed or not
_BYTES_OF_A_LOBE = 16  # likewise, after the first
_BYTES_OF_HEIGHT = 4  # likewise, of a single
_BYTES_A_FILE = 6  # likewise, of three colors
_NOT_LIVE = (
    "This change is too varied for the shader to compute within the tolerance, so frames were "
    "written instead; a lower tolerance may allow it."
)
_NOT_HELD = (
    "A diffuse color and highlights show this measurement with no more than {:.0f} dB: what else "
    "changes with the light's direction is lost. Look at the first frame."
)
_NOT_ENCODED = (
    "The encoder holds this measurement with no more than {:.0f} dB, so it may change as another "
    "material would; the affine temporal model needs no encoder."
)
_NOT_APART = (
    "This change is too varied for the shader to compute within the tolerance, and frames cannot "
    "differ where texels are shown in several places."
)


def age(request: AgeRequest, reporter: Reporter, effort: Effort | None = None) -> dict[str, Any]:
    """Age a material and write its maps; returns the content of `aged.json`.

    `effort` is that of the request's quality unless it is given. Frame 1 is the input. Raises a
    kind of TvbrdfError with a sentence for the user where anything is wrong; the output folder then
    holds what it held before.
    """
    run, effort = Run(request, reporter), effort or EFFORTS[request.quality]
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


def _age(run: Run, effort: Effort, staged: StagedResult) -> dict[str, Any]:
    run.progress("read", 0.0)
    device = device_of(run.request.device)
    start = read_start(run)
    _require_room(run, start, staged, live=start.may_be_live)
    counted = start.counted
    rung = _rung(run, start, counted.initial if start.fit is None else start.fit.one.states)
    with run.timed("model"):
        encoded = _encoded(run, start, rung)
        change = _change(run, start, rung, device, encoded)
        modeled = model_texels(
            counted.initial,
            change,
            effort,
            onset=counted.onset,
            rate=counted.rate,
            residues=counted.residues,
            tolerance=run.request.tolerance,
            step=lambda share: run.progress("model", 0.05 + 0.35 * share),
        )
    live = None
    if start.may_be_live:
        live = _fit_live(run, start, modeled, _each_for_itself(start, change, effort, modeled))
        if live is None:
            if start.apart is not None:
                raise InputError(_NOT_APART, "Unwrap the object, or ask for a lower tolerance.")
            _require_room(run, start, staged, live=False)
    times = np.linspace(0, 1, run.request.frames).tolist()
    with run.timed("write"):
        run.progress("write", 0.4)
        format, files = _write(run, start, modeled, live, times, effort.interval, staged)
        staged.finish()
    account = account_of(
        run,
        start,
        modeled,
        live,
        rung=rung,
        encoded=encoded,
        interval=effort.interval,
        format=format,
        times=times,
        files=files,
    )
    staged.commit(account)
    return account


def _require_room(run: Run, start: Start, staged: StagedResult, *, live: bool) -> None:
    """Raise OutputError where the result could not be written when it is there."""
    request = run.request
    heights = start.laid.residues is not None and start.laid.residues.raises
    lobes = 1 if start.fit is None else start.fit.lobed.lobes
    names = live_names()
    if not live:
        names = file_names(start.format, request.frames, lobes=lobes, heights=heights)
    staged.require_free(names)
    a_frame = _BYTES_A_FRAME + (lobes - 1) * _BYTES_OF_A_LOBE + heights * _BYTES_OF_HEIGHT
    needed = len(names) * _BYTES_A_FILE if live else request.frames * a_frame
    check_space(request.output, start.size[0] * start.size[1] * needed, len(names))


def _encoded(run: Run, start: Start, rung: str) -> Encoded | None:
    """A measured material as latents, where these are rolled out; what is lost is said."""
    if start.fit is None:
        return None
    if start.fit.db < DOUBTFUL:
        run.warn(_NOT_HELD.format(start.fit.db))
    material = start.material
    if rung != LSTM_LATENTS or not isinstance(material, MeasuredBRDF):
        return None
    representation = start.models.representation
    encoded = encode_measured(representation, lambda angles: material.evaluate(angles)[None])
    if (db := float(encoded.db[0])) < DOUBTFUL:
        run.warn(_NOT_ENCODED.format(db))
    return encoded


def _change(
    run: Run, start: Start, rung: str, device: torch.device, encoded: Encoded | None
) -> Change:
    return Change(
        start.models.ntm,
        rung,
        start.models.representation,
        start.models.estimator,
        specular=run.request.specular,
        measured=None if encoded is None else encoded.latents,
        fit=start.fit,
        course=start.course,
        device=device,
        warn=run.warn,
    )


def _each_for_itself(
    start: Start, change: Change, effort: Effort, modeled: AgedTexels
) -> Callable[[Tensor], AgedTexels]:
    """What models some texels without a palette, as if all began to age at once; those of a
    measured material, which are all alike, are `modeled` for themselves already.
    """
    if start.fit is not None:
        return lambda some: modeled.select(torch.zeros(len(some), dtype=torch.long))
    own = replace(effort, step=0.0, checked=False, fit=effort.fit or effort.checked)
    at_once = start.texels.onset is None
    return lambda some: model_texels(
        some, change, own, onset=None if at_once else torch.zeros(len(some))
    )


def _fit_live(
    run: Run, start: Start, modeled: AgedTexels, truth_of: Callable[[Tensor], AgedTexels]
) -> Fitted | None:
    """The live material, or None where none is near enough; said where it was asked for."""
    with run.timed("fit"):
        run.progress("fit", 0.4)
        authored = None
        if start.format == PRINCIPLED and isinstance(start.material, PrincipledMaps):
            authored = authored_texels(start.material, start.size, start.covered)
        live = fit_live(modeled, run.request.tolerance, truth_of, authored)
    if live is None and run.request.binding == LIVE:
        run.warn(_NOT_LIVE)
    return live


def _write(
    run: Run,
    start: Start,
    modeled: AgedTexels,
    live: Fitted | None,
    times: list[float],
    interval: int,
    staged: StagedResult,
) -> tuple[Format, dict[str, Any]]:
    """Write the live material or the frames; returns their format and `files` of `aged.json`."""
    covered, size, wanted = start.covered, start.size, start.format
    aged = modeled if covered is None else start.texels.beside(modeled, covered)
    if live is not None:
        format, files = write_live(live.sum, aged, size, wanted, staged, start.apart)
    else:
        maps = maps_of(aged, start.material, size, wanted, times, covered=covered)
        frames = Frames(maps, times, interval)
        format, files = maps.format, _write_frames(run, frames, staged, start.laid.unit)
    if format != wanted:
        run.warn(
            "Some texels reflect more than the exact Principled mapping can hold (Ks above "
            "0.8, or base color above 1), so Torrance-Sparrow maps were written."
        )
    return format, files


def _write_frames(run: Run, frames: Frames, staged: StagedResult, unit: float) -> dict[str, Any]:
    """Write all frames, or those that are stored, heights in their `unit`; returns `files` of
    `aged.json`.
    """
    request = run.request

    def step(fraction: float) -> None:
        run.progress("write", 0.4 + 0.6 * fraction)

    if request.sparse:
        return write_stored_frames(
            frames, staged, step, tolerance=request.tolerance, seed=request.seed, unit=unit
        )
    return write_frames(frames, staged, step, unit=unit)


def _rung(run: Run, start: Start, initial: Tensor) -> str:
    """The model of change to use: what was asked for, or what suits the material where it has not
    begun to age.
    """
    ntm = start.models.ntm
    if start.course is not None:
        initial = start.course.sound(initial)
    if run.request.temporal_model != AUTO:
        return run.request.temporal_model
    rung, share = ntm.suited(initial)
    if rung == AFFINE and share > FOREIGN_SHARE:
        run.warn(
            f"{share:.0%} of this material is unlike anything {ntm.card.title} was trained on; "
            "a plain affine change is used. Choose a temporal model yourself to override this."
        )
    return rung


def computes() -> tuple[str, str]:
    """What computes with its version, for people, and the kind of device that it takes unasked."""
    return version(), device_of(AUTO).type
