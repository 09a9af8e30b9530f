"""What lives as long as Blender: the warm worker, the run that goes on, how the last one ended."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import bpy
from bpy.app.handlers import persistent

from ..model_runtime.contract import CPU
from ..model_runtime.errors import shown
from ..model_runtime.output.commit import recover
from . import preferences
from .errors import SettingsError
from .log import tell
from .run import Run, plan, take_preview_back
from .worker import Worker

__all__ = (
    "Outcome",
    "age_and_wait",
    "begin",
    "current",
    "finish",
    "forget",
    "is_cold",
    "outcome",
    "register",
    "stop_worker",
    "unregister",
    "worker_in_words",
)

# Between two looks at the worker where nothing else is to be done.
POLL_SECONDS = 0.05


@dataclass(frozen=True)
class Outcome:
    """How a run ended, for the panel of the material it was about.

    `sentences` are its warnings, or why it failed; `icon` goes before each.  `next` says what to do
    with what it made.
    """

    material_uid: int
    material_name: str
    icon: Literal["NONE", "ERROR"]
    sentences: tuple[str, ...]
    next: str = ""


_worker: Worker | None = None
_current: Run | None = None
_outcome: Outcome | None = None


def current() -> Run | None:
    """The run that goes on."""
    return _current


def outcome() -> Outcome | None:
    """How the last run ended."""
    return _outcome


def is_cold() -> bool:
    """Whether the next run has to start the worker first."""
    return _worker is None or not _worker.alive


def worker_in_words() -> str:
    """One sentence: whether the worker is there, and what computes in it as far as it has said."""
    if _worker is None or is_cold():
        return "The worker starts with the next run."
    if (loaded := _worker.loaded) is None or not loaded.backend:
        return "The worker is there."
    where = "the CPU" if loaded.device == CPU else "the GPU"
    return f"The worker is ready, with {shown(loaded.backend)} on {where}."


def begin(
    material: bpy.types.Material,
    scene: bpy.types.Scene,
    object_name: str = "",
    *,
    preview: bool = False,
    binding: str | None = None,
    kind: type[Run] = Run,
) -> Run:
    """A run that ages `material`, to be stepped until it ends and then given to `finish`.

    It is read from the object called `object_name`, or else from one that shows it.  With `preview`
    it first shows a small draft, for somebody who watches; `binding`, where it is not None, takes
    the place of the material's setting; `kind` is what the run does.

    Raises:
        SettingsError: another run goes on.
        TvbrdfError: why this one cannot begin.
    """
    global _current
    if _current is not None:
        raise SettingsError(
            f"{_current.plan.material_name} is being aged.", "Wait for it to end, or cancel it."
        )
    planned = plan(material, scene, object_name, binding=binding)
    _current = kind(planned, _warm_worker(), preview=preview)
    return _current


def finish(
    run: Run, *, icon: Literal["NONE", "ERROR"], sentences: tuple[str, ...], next: str = ""
) -> None:
    """Let go of a run that has ended, however it did, and keep what is to be said of it."""
    global _current, _outcome
    run.close()
    if _current is run:
        _current = None
    _outcome = Outcome(run.plan.material_uid, run.plan.material_name, icon, sentences, next)


def forget(material: bpy.types.Material) -> None:
    """Say no more of how a run of `material` ended."""
    global _outcome
    if _outcome is not None and _outcome.material_uid == material.session_uid:
        _outcome = None


def age_and_wait(
    material: bpy.types.Material,
    scene: bpy.types.Scene,
    object_name: str = "",
    *,
    cancelled: Callable[[], bool] = lambda: False,
    binding: str | None = None,
    kind: type[Run] = Run,
    told: Callable[[Run], None] | None = None,
) -> Run:
    """Age `material` here and now; the run, at its end.

    It is read from the object called `object_name`, or else from one that shows it.  `told` hears
    of each step; without it stages are printed.

    Raises:
        TvbrdfError: as `Run.step`.
    """
    run = begin(material, scene, object_name, binding=binding, kind=kind)
    told = told or _by_stage()
    sentences: tuple[str, ...] = ()
    try:
        while run.step():
            if cancelled():
                run.cancel()
            told(run)
            time.sleep(POLL_SECONDS)
        sentences = tuple(run.warnings)
        for warning in sentences:
            tell(f"{run.plan.material_name}: Warning: {warning}")
    finally:
        finish(run, icon="ERROR", sentences=sentences)
    return run


def _by_stage() -> Callable[[Run], None]:
    said = ""

    def tell_of(run: Run) -> None:
        nonlocal said
        if run.stage != said:
            said = run.stage
            tell(f"{run.plan.material_name}: {run.fraction:4.0%} {run.stage}")

    return tell_of


def stop_worker() -> None:
    """End the run, if any, and the worker; the next run starts another."""
    global _worker
    run, worker, _worker = _current, _worker, None
    if run is not None:
        run.end("The extension was disabled.")
    if worker is not None:
        worker.stop()
    if run is not None:
        recover(run.plan.folder)


def _warm_worker() -> Worker:
    global _worker
    launch = preferences.launch()
    if _worker is not None and _worker.launch != launch:
        stop_worker()
    if _worker is None:
        _worker = Worker(launch)
    return _worker


@persistent
def _on_undo(_scene: bpy.types.Scene) -> None:
    if _current is not None:
        _current.end("Aging ended, because undo may have changed the material meanwhile.")


@persistent
def _on_load(_file: object) -> None:
    if _current is not None:
        _current.end("Aging ended, because another file was opened.")


@persistent
def _on_save(_file: object) -> None:
    # The files of a preview are gone tomorrow.
    for material in bpy.data.materials:
        take_preview_back(material)


def _handlers() -> tuple[tuple[list, object], ...]:
    handlers = bpy.app.handlers
    return (
        (handlers.undo_post, _on_undo),
        (handlers.redo_post, _on_undo),
        (handlers.load_pre, _on_load),
        (handlers.save_pre, _on_save),
    )


def register() -> None:
    for handlers, function in _handlers():
        handlers.append(function)


def unregister() -> None:
    global _current, _outcome
    for handlers, function in _handlers():
        # Somebody else may have emptied the list.
        if function in handlers:
            handlers.remove(function)
    stop_worker()
    # What is enabled again later may find this module as it was left.
    _current = _outcome = None
