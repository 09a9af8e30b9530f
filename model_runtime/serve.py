"""The worker: one JSON message a line on stdin and stdout, protocol 1.

Requests are `{"id", "verb", "args"}`, with the verbs `age`, `look`, `info`, `cancel` and
`shutdown`.  Replies carry the request's `id` and a `type`: `progress` (`stage`, `fraction`),
`warning` (`message`), `error` (`code`, `message`, `hint`) or `done` (`result`).  The first line of
all is `ready` (`protocol`, `version`); `loaded` says that what computes is imported.  While it
imports or ages, an `alive` comes every two seconds.  What is no request, or a wrong one, gets an
error reply; the worker goes on.

The main thread ages, one request at a time.  A second thread reads stdin and answers everything
else at once, so that a run can be cancelled; a third gives the signs of life.  The process ends
when it is asked to, after a time without a run, and when stdin closes, which it does however
Blender ended.
"""

from __future__ import annotations

import os
import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, BinaryIO, TextIO

from . import __version__
from .contract import PROTOCOL
from .errors import Cancelled, TvbrdfError, UsageError, reason, shown
from .memory import memory_in_words
from .messages import (
    Alive,
    Done,
    Failed,
    Loaded,
    Message,
    Notice,
    Progress,
    Ready,
    Reply,
    Request,
)
from .output.kept import Kept
from .request import MissingLibraryError, cards, load_age, load_look, request_from

__all__ = ("Server", "claim_stdout", "serve")


# How long a run may take to notice that stdin has closed before the process ends under it.
GRACE_SECONDS = 20.0
HEARTBEAT_SECONDS = 2.0
# A request is some paths and numbers.
LONGEST_LINE = 1 << 20


class Server:
    """Answers the requests that come in on `requests` with lines on `replies`.

    `idle_seconds` is how long it waits for a next run before it ends; results are taken from what
    is `kept`.
    """

    def __init__(
        self,
        *,
        requests: BinaryIO,
        replies: TextIO,
        idle_seconds: float,
        kept: Kept | None = None,
    ) -> None:
        self._requests = requests
        self._replies = replies
        self._kept = kept
        self._idle_seconds = min(idle_seconds, threading.TIMEOUT_MAX)
        self._reply_lock = threading.Lock()
        self._busy = threading.Event()
        self._runs: queue.Queue[_Run | None] = queue.Queue()
        # Guards `_run`, the run that is going on or about to begin.
        self._run_lock = threading.Lock()
        self._run: _Run | None = None

    def serve(self) -> None:
        """Announce readiness, then age what is asked for until there is a reason to end."""
        self._say(Ready(PROTOCOL, __version__))
        self._busy.set()
        for work in (self._read, self._give_signs_of_life):
            threading.Thread(target=work, daemon=True).start()
        self._say(_warm_up(self._kept))
        while True:
            self._busy.clear()
            try:
                run = self._runs.get(timeout=self._idle_seconds)
            except queue.Empty:
                return
            if run is None:
                return
            self._busy.set()
            self._carry_out(run)

    def _give_signs_of_life(self) -> None:
        while self._busy.wait():
            self._say(Alive())
            time.sleep(HEARTBEAT_SECONDS)

    def _read(self) -> None:
        try:
            while line := self._requests.readline(LONGEST_LINE):
                if len(line) == LONGEST_LINE and not line.endswith(b"\n"):
                    self._skip_line()
                    self._refuse(None, "This line is too long for a request.")
                elif line.strip() and not self._handle(line):
                    break
        finally:
            self._end()

    def _skip_line(self) -> None:
        while (rest := self._requests.readline(LONGEST_LINE)) and not rest.endswith(b"\n"):
            pass

    def _handle(self, line: bytes) -> bool:
        """Answer one request or queue its run; False where it was the last one."""
        request = Request.read(line)
        if request is None:
            start = shown(line[:200].decode(errors="replace").strip())
            self._refuse(None, f"This is not a request: {start}")
            return True
        match request.verb:
            case "age" | "look":
                load = load_look if request.verb == "look" else partial(load_age, self._kept)
                self._accept(_Run(self, request, load))
            case "cancel":
                self._answer(request.id, lambda: self._cancel_run(request.args.get("id")))
            case "info":
                self._answer(request.id, lambda: _cards(request.args))
            case "shutdown":
                self._say(Done({}), request.id)
                return False
            case _:
                self._refuse(request.id, f"There is no verb {shown(request.verb)}.")
        return True

    def _accept(self, run: _Run) -> None:
        with self._run_lock:
            if self._run is not None:
                busy = "The worker is busy with another run.", "Wait for it to end, or cancel it."
                self._say(Failed("busy", *busy), run.id)
                return
            self._run = run
        self._runs.put(run)

    def _cancel_run(self, request_id: Any) -> dict[str, Any]:
        with self._run_lock:
            if self._run is None or request_id not in (None, self._run.id):
                raise UsageError("There is no such run to cancel.", "It may have just ended.")
            self._run.cancel()
        return {}

    def _end(self) -> None:
        with self._run_lock:
            running = self._run is not None
            if self._run is not None:
                self._run.cancel()
        self._runs.put(None)
        # Neither a run that is deep in one long computation nor the import of torch may keep it.
        timer = threading.Timer(GRACE_SECONDS if running else 0.0, os._exit, args=(0,))
        timer.daemon = True
        timer.start()

    def _carry_out(self, run: _Run) -> None:
        def result() -> dict[str, Any]:
            try:
                return run.result()
            finally:
                with self._run_lock:
                    self._run = None

        self._answer(run.id, result)

    def _answer(self, request_id: int | str, compute: Callable[[], Any]) -> None:
        """Reply with what `compute` returns, or why it does not."""
        try:
            with memory_in_words("Choose a smaller size or fewer frames."):
                line = Reply(Done(compute()), request_id).line()
        except TvbrdfError as error:
            line = Reply(Failed(error.code, error.message, error.hint), request_id).line()
        except Exception as error:
            traceback.print_exc()
            line = Reply(_unforeseen(error), request_id).line()
        self._write(line)

    def _refuse(self, request_id: int | str | None, message: str) -> None:
        self._say(Failed("protocol", message, ""), request_id)

    def _say(self, message: Message, request_id: int | str | None = None) -> None:
        self._write(Reply(message, request_id).line())

    def _write(self, line: str) -> None:
        with self._reply_lock:
            try:
                self._replies.write(line + "\n")
                self._replies.flush()
            except (OSError, ValueError):
                # Nobody listens any more: stdin closes as well, which ends the process.
                return


class _Run:
    """One `age` or `look` request, and the reporter that it gives to whoever carries it out."""

    def __init__(
        self, server: Server, request: Request, load: Callable[[], Callable[..., dict[str, Any]]]
    ) -> None:
        self.id = request.id
        self._server = server
        self._load = load
        self._args = request.args
        self._cancelled = threading.Event()

    def result(self) -> dict[str, Any]:
        carry_out = self._load()
        if self.cancelled():
            raise Cancelled
        return carry_out(request_from(self._args), self)

    def cancel(self) -> None:
        self._cancelled.set()

    def progress(self, stage: str, fraction: float) -> None:
        self._server._say(Progress(stage, fraction), self.id)

    def warning(self, message: str) -> None:
        self._server._say(Notice(message), self.id)

    def cancelled(self) -> bool:
        return self._cancelled.is_set()


def serve(*, idle_seconds: float, kept: Kept | None = None) -> None:
    """Serve on this process's stdin and stdout, keeping both from everything else in it.

    A library that prints, or a child that reads, must not get between the messages.
    """
    replies = claim_stdout()
    requests = os.fdopen(os.dup(0), "rb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    Server(requests=requests, replies=replies, idle_seconds=idle_seconds, kept=kept).serve()
    # Not sys.exit: the reading thread may hold `requests`, whose lock the shutdown would wait for.
    sys.stderr.flush()
    os._exit(0)


def claim_stdout() -> TextIO:
    """This process's stdout, for the caller alone: what anything else prints goes to stderr."""
    sys.stdout.flush()
    claimed = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return claimed


def _warm_up(kept: Kept | None) -> Loaded:
    """Import what computes before the first run; what stands in the way is told by that."""
    try:
        load_age(kept)
        from .age import computes

        return Loaded(*computes())
    except MissingLibraryError as error:
        print(error, file=sys.stderr)
    except Exception:
        traceback.print_exc()
    return Loaded()


def _cards(args: Mapping[str, Any]) -> list[dict[str, Any]]:
    ntm = args.get("ntm")
    if not isinstance(ntm, str | None):
        raise UsageError("The setting ntm must be text.")
    return cards(ntm)


def _unforeseen(error: Exception) -> Failed:
    message = f"This should not happen ({type(error).__name__}: {reason(error)})."
    return Failed("internal", message, "", traceback.format_exc())
