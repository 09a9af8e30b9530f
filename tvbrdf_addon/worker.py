"""The worker process, seen from Blender.  Imports no bpy; nothing here waits for the worker.

    worker = Worker(Launch(runtime=folder_that_holds_model_runtime))
    for message in run(worker, "age", {...}, cancelled=lambda: escape_pressed):
        match message:
            case None: ...                        # nothing new; look again a little later
            case Progress(stage, fraction): ...
            case Notice(text): ...
            case Done(result): ...

The same generator serves the modal operator, which advances it in a timer, and the blocking path,
which sleeps between its steps.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from ..model_runtime.contract import PROTOCOL
from ..model_runtime.errors import shown
from ..model_runtime.messages import Done, Failed, Message, Notice, Progress, Verb
from .errors import WorkerError
from .launch import Launch
from .process import Worker

__all__ = ("Done", "Launch", "News", "Notice", "Progress", "Worker", "learn", "prepare", "run")

# Starting means starting Python and reading a few small files, then, after `ready`, importing
# torch: a slow disk may keep one library of it for long, and all else in the process with it.
START_SECONDS = 60.0
# A worker that has torch gives a sign of life every two seconds.
SILENCE_SECONDS = 10.0
# A run notices a cancel between two batches of texels.
CANCEL_SECONDS = 15.0
LONGEST_NOTICE = 600
LEARN = "learn"
"""The id of all that a worker which learns says."""
# A longer pause between two looks was not spent waiting.
LOOK_SECONDS = 1.0


News = Progress | Notice | Done
"""What a run tells on its way, and at its end."""


class _Patience:
    """How long something has been waited for.

    While the machine sleeps, or Blender does something else for a minute, nobody waits: the clock
    may jump, and a stretch between two looks counts for a second at most.
    """

    def __init__(self) -> None:
        self._waited = 0.0
        self._looked = time.monotonic()

    def is_over(self, seconds: float) -> bool:
        now = time.monotonic()
        self._waited += min(now - self._looked, LOOK_SECONDS)
        self._looked = now
        return self._waited > seconds


class _LeftError(Exception):
    """The worker had been idle for long and left just as the request came."""


def prepare(worker: Worker) -> None:
    """Start `worker` where it is not there: it gets ready while something else is done.

    Raises:
        WorkerError: it could not be started.
    """
    if not worker.alive:
        worker.stop()
        worker.start()


def run(
    worker: Worker,
    verb: Verb,
    args: Mapping[str, Any],
    *,
    cancelled: Callable[[], bool] = lambda: False,
) -> Iterator[News | None]:
    """Carry out one request, starting the worker where needed; None means nothing new yet.

    Closing the generator early cancels the request.

    Raises:
        WorkerError: the worker reported an error (`code` is its own; `cancelled` after a cancel),
            could not be started, died, gave no sign of life, or speaks another protocol.
    """
    for is_last in (False, True):
        prepare(worker)
        yield from _await_ready(worker, cancelled)
        try:
            yield from _await_answer(worker, worker.send(verb, args), cancelled)
        except _LeftError:
            if is_last:
                raise _death(worker) from None
        else:
            return


def learn(worker: Worker, *, cancelled: Callable[[], bool]) -> Iterator[News | None]:
    """Let a worker that is to learn do so, and end it; it says what `run` says, and raises it.

    It may be silent for as long as it likes, as no run waits for it.
    """
    worker.start()
    try:
        yield from _await_answer(worker, LEARN, cancelled, silence=math.inf)
    except _LeftError:
        raise _death(worker) from None
    finally:
        worker.stop(at_once=True)


def _await_ready(worker: Worker, cancelled: Callable[[], bool]) -> Iterator[None]:
    patience = _Patience()
    while worker.ready is None:
        alive = worker.alive
        for _ in worker.poll():
            pass
        if worker.ready is not None:
            break
        if not alive:
            raise _death(worker)
        if cancelled():
            worker.stop()
            raise _cancelled()
        if patience.is_over(START_SECONDS):
            worker.stop(at_once=True)
            raise WorkerError(
                f"The worker has not answered for {START_SECONDS:.0f} seconds.",
                "Check Worker Python in the extension's preferences.",
            )
        yield None
    spoken = worker.ready.protocol
    if spoken != PROTOCOL:
        worker.stop()
        raise WorkerError(
            f"The worker speaks protocol {shown(spoken)}, this extension {PROTOCOL}.",
            "Restart Blender after an update; if that does not help, install the extension again.",
            code="protocol",
        )


def _await_answer(
    worker: Worker,
    request_id: int | str,
    cancelled: Callable[[], bool],
    *,
    silence: float | None = None,
) -> Iterator[News | None]:
    heard, quiet, since_cancel = False, _Patience(), None
    try:
        while True:
            # Asked before looking into the inbox: what it said before it died is in there.
            alive = worker.alive
            for reply in worker.poll():
                quiet = _Patience()
                if reply.id != request_id:
                    continue
                heard = True
                yield (told := _told(reply.message))
                if isinstance(told, Done):
                    return
            if not alive:
                if worker.exit_code == 0 and not heard and since_cancel is None:
                    raise _LeftError
                raise _death(worker)
            if cancelled() and since_cancel is None:
                worker.send("cancel", {"id": request_id})
                since_cancel = _Patience()
            if since_cancel is not None and since_cancel.is_over(CANCEL_SECONDS):
                worker.stop(at_once=True)
                raise _cancelled()
            most = silence or (SILENCE_SECONDS if worker.loaded else START_SECONDS)
            if quiet.is_over(most):
                worker.stop(at_once=True)
                raise _cancelled() if since_cancel is not None else _silence(worker)
            yield None
    except (GeneratorExit, KeyboardInterrupt):
        if worker.alive:
            worker.send("cancel", {"id": request_id})
        raise


def _told(message: Message | None) -> News | None:
    """What `message` of the worker means to whoever runs something; raises WorkerError."""
    match message:
        case Progress(stage, fraction):
            # In this order NaN becomes 0.
            return Progress(shown(stage), min(max(0.0, fraction), 1.0))
        case Notice(text):
            return Notice(shown(text, most=LONGEST_NOTICE))
        case Done():
            return message
        case Failed(code, text, hint, details):
            raise WorkerError(
                text or "The worker reported an error without words.",
                hint,
                code=code or "internal",
                details=details,
            )
    return None


def _death(worker: Worker) -> WorkerError:
    code = worker.exit_code
    how = f"was killed by signal {-code}" if code is not None and code < 0 else f"ended ({code})"
    message = f"The worker {how} before it had finished."
    if code == -9:
        hint = "Perhaps memory ran out: choose a smaller size, or press the button again."
        return WorkerError(message, hint, code="died")
    words = worker.last_words().strip()
    if words:
        hint = f"Its last words: {shown(words.splitlines()[-1], most=200)}."
    else:
        hint = "Press the button again; if that does not help, install the extension again."
    return WorkerError(message, hint, code="died", details=words)


def _silence(worker: Worker) -> WorkerError:
    seconds = SILENCE_SECONDS if worker.loaded else START_SECONDS
    return WorkerError(
        f"The worker gave no sign of life for {seconds:.0f} seconds and was ended.",
        "Press the button again; if that does not help, choose a smaller size.",
        code="silent",
    )


def _cancelled() -> WorkerError:
    return WorkerError("Canceled; the earlier result is untouched.", code="cancelled")
