"""The worker's process and its pipes.  Imports no bpy; nothing here waits for the worker."""

from __future__ import annotations

import atexit
import contextlib
import io
import os
import queue
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator, Mapping
from typing import IO, Any

from ..model_runtime.messages import Loaded, Ready, Reply, Request, Verb
from .errors import WorkerError
from .launch import Launch

__all__ = ("Worker",)

SHUTDOWN_SECONDS = 2.0

# <fcntl.h> of macOS, which Python's fcntl does not name.
F_SETNOSIGPIPE = 73


class Worker:
    """A child process that stays warm between runs and is started when it is needed.

    Three threads carry what is said to it and what it says, so that neither it nor Blender ever
    waits for the other.  `ready` is its first word, once that has been looked at; `loaded` says
    that what computes is imported, so that it answers soon, and what that is.
    """

    def __init__(self, launch: Launch) -> None:
        self.launch = launch
        self.ready: Ready | None = None
        self.loaded: Loaded | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._inbox: queue.Queue[Reply] = queue.Queue()
        self._outbox: queue.Queue[bytes | None] = queue.Queue()
        self._complaints: deque[str] = deque(maxlen=40)
        self._readers: list[threading.Thread] = []
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
                # A buffer would be written out by whoever closes the pipe.
                bufsize=0,
                cwd=str(self.launch.runtime),
                env=environment,
                creationflags=flags,
                start_new_session=sys.platform != "win32",
            )
        except (OSError, ValueError) as error:
            raise WorkerError(
                f"The worker {command[0]} cannot be started: "
                f"{getattr(error, 'strerror', None) or error}.",
                "Choose another Worker Python in the extension's preferences.",
            ) from error
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        self._process, self.ready, self.loaded = process, None, None
        self._inbox, self._outbox = queue.Queue(), queue.Queue()
        self._complaints.clear()
        self._readers = [
            threading.Thread(target=_read, args=(process.stdout, self._inbox), daemon=True),
            threading.Thread(target=_listen, args=(process.stderr, self._complaints), daemon=True),
        ]
        writer = threading.Thread(target=_write, args=(process.stdin, self._outbox), daemon=True)
        for thread in (writer, *self._readers):
            thread.start()
        atexit.register(self.stop)

    def send(self, verb: Verb, args: Mapping[str, Any]) -> int:
        """Send one request; its id.  A dead worker shows in `alive`, not here."""
        self._last_id += 1
        self._say(Request(self._last_id, verb, args))
        return self._last_id

    def poll(self) -> Iterator[Reply]:
        """What it has said by now."""
        for _ in range(self._inbox.qsize()):
            reply = self._inbox.get_nowait()
            match reply.message:
                case Ready():
                    self.ready = reply.message
                case Loaded():
                    self.loaded = reply.message
            yield reply

    def last_words(self) -> str:
        """What the worker wrote to stderr last, for the console; complete once it is dead."""
        if not self.alive:
            for thread in self._readers:
                thread.join(timeout=1.0)
        return "\n".join(self._complaints)

    def stop(self, *, at_once: bool = False) -> None:
        """End the process: killed `at_once`, or asked first and killed after two seconds."""
        atexit.unregister(self.stop)
        process = self._process
        if process is None:
            return
        self._say(Request(0, "shutdown", {}))
        self._outbox.put(None)
        self._process = None
        if not at_once:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=SHUTDOWN_SECONDS)
        if process.poll() is None:
            _kill(process)
        for thread in self._readers:
            thread.join(timeout=1.0)

    def _say(self, request: Request) -> None:
        self._outbox.put(request.line().encode() + b"\n")


def _kill(process: subprocess.Popen[bytes]) -> None:
    if sys.platform == "win32":
        process.kill()
    else:
        # Its group, which is its own: a script of the user's may have started the real worker.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    # Even a killed process may wait for a disk that does not answer.
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(timeout=SHUTDOWN_SECONDS)


def _write(pipe: IO[bytes], outbox: queue.Queue[bytes | None]) -> None:
    """Write what comes into `outbox`, until None comes, or nobody reads it any more."""
    _refuse_sigpipe(pipe)
    # Whoever waits for the answer of a worker that has left finds out, and says why.
    with contextlib.suppress(OSError), pipe:
        while (line := outbox.get()) is not None:
            rest = memoryview(line)
            while rest:
                rest = rest[pipe.write(rest) :]


def _refuse_sigpipe(pipe: IO[bytes]) -> None:
    """Let writing to `pipe` from this thread fail, not end Blender, where its reader has left.

    Python ignores SIGPIPE; Blender leaves it at its default, which is to end the process, and
    that is not ours to change.  The kernel sends it to the thread that writes, where it stays
    blocked and ends with the thread.  macOS sends it to the whole process, but not for a pipe that
    is marked.
    """
    if sys.platform == "darwin":
        import fcntl

        fcntl.fcntl(pipe, F_SETNOSIGPIPE, 1)
    elif sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGPIPE})


def _read(pipe: IO[bytes], inbox: queue.Queue[Reply]) -> None:
    for line in _lines(pipe):
        if (reply := Reply.read(line)) is not None:
            inbox.put(reply)
        elif line.strip():
            # Not ours: a library that found its way to stdout.
            print(f"tvbrdf worker: {line[:200]!a}", file=sys.stderr)


def _listen(pipe: IO[bytes], complaints: deque[str]) -> None:
    complaints.extend(line.rstrip() for line in _lines(pipe))


def _lines(pipe: IO[bytes]) -> Iterator[str]:
    """The lines of `pipe`, which is closed after the last."""
    assert isinstance(pipe, io.RawIOBase)  # as a process without a buffer has them
    with io.TextIOWrapper(io.BufferedReader(pipe), encoding="utf-8", errors="replace") as text:
        yield from text
