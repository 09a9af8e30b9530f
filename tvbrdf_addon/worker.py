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

import atexit
import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from .errors import WorkerError

__all__ = ("PROTOCOL", "Done", "Launch", "Message", "Notice", "Progress", "Worker", "run")

PROTOCOL = 1
ENVIRONMENT_VARIABLE = "TVBRDF_WORKER"

# Starting means starting Python and reading a few small files: torch comes after `ready`.
START_SECONDS = 60.0
# A run notices a cancel between two batches of texels.
CANCEL_SECONDS = 15.0
SHUTDOWN_SECONDS = 2.0

# The worker's own Python code: no user site, no PYTHON* variables, our paths before all others.
BOOTSTRAP = """\
import runpy, sys
sys.path[:0] = {paths!r}
sys.argv[1:] = {arguments!r}
runpy.run_module("model_runtime", run_name="__main__", alter_sys=True)
"""


@dataclass(frozen=True)
class Progress:
    """How far a run is: `fraction` of the whole, 0 to 1."""

    stage: str
    fraction: float


@dataclass(frozen=True)
class Notice:
    """Something the user should know about the run; it goes on."""

    text: str


@dataclass(frozen=True)
class Done:
    """The end of a run that succeeded; for `age`, the content of `aged.json`."""

    result: Any


Message = Progress | Notice | Done


@dataclass(frozen=True)
class Launch:
    """What it takes to start a worker.

    `interpreter` is a Python chosen by the user, or a script that speaks the protocol (`.py`);
    empty means `TVBRDF_WORKER`, and without that Blender's own Python together with
    `site_packages`, where Blender has unpacked the extension's wheels.
    """

    runtime: Path
    site_packages: tuple[Path, ...] = ()
    interpreter: str = ""
    idle_minutes: float = 10.0

    def command(self) -> list[str]:
        """The command line of the worker.

        Raises:
            WorkerError: the chosen interpreter is not there.
        """
        arguments = ["serve", "--idle-minutes", f"{self.idle_minutes:g}"]
        chosen = self.interpreter or os.environ.get(ENVIRONMENT_VARIABLE, "")
        if not chosen:
            paths = [str(self.runtime), *map(str, self.site_packages)]
            bootstrap = BOOTSTRAP.format(paths=paths, arguments=arguments)
            return [sys.executable, "-I", "-c", bootstrap]
        path = Path(chosen).expanduser()
        if not path.is_file():
            raise WorkerError(
                f"There is no worker at {path}.",
                f"Choose another Worker Python in the extension's preferences, or change "
                f"{ENVIRONMENT_VARIABLE}.",
            )
        if path.suffix == ".py":
            return [sys.executable, str(path), *arguments]
        # A Python of the user's choice brings its own torch, which ours must not hide.
        bootstrap = BOOTSTRAP.format(paths=[str(self.runtime)], arguments=arguments)
        return [str(path), "-c", bootstrap]


class Worker:
    """A child process that stays warm between runs and is started when it is needed.

    Everything it says is taken off its pipes by two threads, so that neither it nor Blender ever
    waits for the other.
    """

    def __init__(self, launch: Launch) -> None:
        self.launch = launch
        self._process: subprocess.Popen[str] | None = None
        self._inbox: queue.Queue[dict[str, Any]] = queue.Queue()
        self._complaints: deque[str] = deque(maxlen=40)
        self._threads: list[threading.Thread] = []
        self._last_id = 0

    @property
    def pid(self) -> int | None:
        """The process id while it lives."""
        return self._process.pid if self._process is not None and self.alive else None

    @property
    def alive(self) -> bool:
        return self._process is not None and self._process.poll() is None

    @property
    def exit_code(self) -> int | None:
        return None if self._process is None else self._process.poll()

    def start(self) -> None:
        """Start the process; its `ready` comes by way of `poll`.

        Raises:
            WorkerError: the interpreter is missing or cannot be run.
        """
        assert not self.alive
        command = self.launch.command()
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        # On Windows Ctrl-C in the console would end the worker together with Blender's run.
        flags = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
        flags |= getattr(subprocess, "CREATE_NO_WINDOW", 0)
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                errors="replace",
                cwd=str(self.launch.runtime),
                env=environment,
                creationflags=flags,
                start_new_session=sys.platform != "win32",
            )
        except OSError as error:
            raise WorkerError(
                f"The worker {command[0]} cannot be started: {error.strerror or error}.",
                "Choose another Worker Python in the extension's preferences.",
            ) from error
        assert process.stdout is not None
        assert process.stderr is not None
        self._process = process
        self._inbox = queue.Queue()
        self._complaints.clear()
        self._threads = [
            threading.Thread(target=_read, args=(process.stdout, self._inbox), daemon=True),
            threading.Thread(target=_listen, args=(process.stderr, self._complaints), daemon=True),
        ]
        for thread in self._threads:
            thread.start()
        atexit.register(self.stop)

    def send(self, verb: str, args: Mapping[str, Any]) -> int:
        """Send one request; its id.  A dead worker shows in `alive`, not here."""
        assert self._process is not None
        assert self._process.stdin is not None
        self._last_id += 1
        request = {"id": self._last_id, "verb": verb, "args": dict(args)}
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except (OSError, ValueError):
            # It has just died; whoever waits for the answer finds out, and says why.
            pass
        return self._last_id

    def poll(self) -> Iterator[dict[str, Any]]:
        """The messages that have come in."""
        while True:
            try:
                yield self._inbox.get_nowait()
            except queue.Empty:
                return

    def last_words(self) -> str:
        """What the worker wrote to stderr last, for the console; complete once it is dead."""
        if not self.alive:
            for thread in self._threads:
                thread.join(timeout=1.0)
        return "\n".join(self._complaints)

    def stop(self) -> None:
        """End the process: asked first, killed after two seconds."""
        atexit.unregister(self.stop)
        process, self._process = self._process, None
        if process is None:
            return
        assert process.stdin is not None
        try:
            process.stdin.write(json.dumps({"id": 0, "verb": "shutdown", "args": {}}) + "\n")
            process.stdin.close()
        except (OSError, ValueError):
            # Already dead.
            pass
        try:
            process.wait(timeout=SHUTDOWN_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for thread in self._threads:
            thread.join(timeout=1.0)
        for pipe in (process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()


def run(
    worker: Worker,
    verb: str,
    args: Mapping[str, Any],
    *,
    cancelled: Callable[[], bool] = lambda: False,
) -> Iterator[Message | None]:
    """Carry out one request, starting the worker where needed; None means nothing new yet.

    Closing the generator early cancels the request.

    Raises:
        WorkerError: the worker reported an error (`code` is its own; `cancelled` after a cancel),
            could not be started, died, or speaks another protocol.
    """
    if not worker.alive:
        worker.stop()
        worker.start()
        yield from _await_ready(worker, cancelled)
    request_id = worker.send(verb, args)
    heard, cancel_deadline = False, None
    try:
        while True:
            # Asked before looking into the inbox: what it said before it died is in there.
            alive = worker.alive
            for message in worker.poll():
                if message.get("id") != request_id:
                    continue
                heard = True
                yield (typed := _typed(message))
                if isinstance(typed, Done):
                    return
            if not alive:
                if worker.exit_code == 0 and not heard and cancel_deadline is None:
                    # It had been idle for long and left just as the request came.
                    yield from run(worker, verb, args, cancelled=cancelled)
                    return
                raise _death(worker)
            if cancelled() and cancel_deadline is None:
                worker.send("cancel", {"id": request_id})
                cancel_deadline = time.monotonic() + CANCEL_SECONDS
            if cancel_deadline is not None and time.monotonic() > cancel_deadline:
                worker.stop()
                raise _cancelled()
            yield None
    except GeneratorExit:
        if worker.alive:
            worker.send("cancel", {"id": request_id})
        raise


def _await_ready(worker: Worker, cancelled: Callable[[], bool]) -> Iterator[None]:
    deadline = time.monotonic() + START_SECONDS
    while True:
        alive = worker.alive
        for message in worker.poll():
            if message.get("type") != "ready":
                continue
            if message.get("protocol") == PROTOCOL:
                return
            worker.stop()
            raise WorkerError(
                f"The worker speaks protocol {message.get('protocol')}, this extension {PROTOCOL}.",
                "Restart Blender after an update; if that does not help, install the extension "
                "again.",
                code="protocol",
            )
        if not alive:
            raise _death(worker)
        if cancelled():
            worker.stop()
            raise _cancelled()
        if time.monotonic() > deadline:
            worker.stop()
            raise WorkerError(
                f"The worker has not answered for {START_SECONDS:.0f} seconds.",
                "Check Worker Python in the extension's preferences.",
            )
        yield None


def _typed(message: Mapping[str, Any]) -> Message | None:
    match message:
        case {"type": "progress", "stage": str(stage), "fraction": int() | float() as fraction}:
            return Progress(stage, min(max(float(fraction), 0.0), 1.0))
        case {"type": "warning", "message": str(text)}:
            return Notice(text)
        case {"type": "done", "result": result}:
            return Done(result)
        case {"type": "error"}:
            raise WorkerError(
                str(message.get("message") or "The worker reported an error without words."),
                str(message.get("hint") or ""),
                code=str(message.get("code") or "internal"),
            )
    return None


def _death(worker: Worker) -> WorkerError:
    words = worker.last_words()
    if words:
        print(words, file=sys.stderr)
    code = worker.exit_code
    how = f"was killed by signal {-code}" if code is not None and code < 0 else f"ended ({code})"
    last_line = words.strip().rpartition("\n")[2][:200]
    if code == -9:
        hint = "Perhaps memory ran out: choose a smaller size, or press the button again."
    elif last_line:
        hint = f"Its last words: {last_line} (the system console shows more)."
    else:
        hint = "Press the button again; if that does not help, install the extension again."
    return WorkerError(f"The worker {how} before it had finished.", hint, code="died")


def _cancelled() -> WorkerError:
    return WorkerError("Cancelled; the earlier result is untouched.", code="cancelled")


def _read(pipe: IO[str], inbox: queue.Queue[dict[str, Any]]) -> None:
    for line in _lines(pipe):
        try:
            message = json.loads(line)
        except ValueError:
            message = None
        if isinstance(message, dict):
            inbox.put(message)
        elif line.strip():
            # Not ours: a library that found its way to stdout.
            print(f"tvbrdf worker: {line.rstrip()}", file=sys.stderr)


def _listen(pipe: IO[str], complaints: deque[str]) -> None:
    complaints.extend(line.rstrip() for line in _lines(pipe))


def _lines(pipe: IO[str]) -> Iterator[str]:
    try:
        yield from pipe
    except ValueError:
        # The pipe was closed under us: the worker was stopped.
        return
