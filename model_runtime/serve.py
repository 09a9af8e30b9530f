"""The worker: one JSON message a line on stdin and stdout, protocol 1.

Requests are `{"id", "verb": "age" | "info" | "cancel" | "shutdown", "args"}`.  Replies carry the
request's `id` and a `type`: `progress` (`stage`, `fraction`), `warning` (`message`), `error`
(`code`, `message`, `hint`) or `done` (`result`).  The first line of all is `ready` (`protocol`,
`version`).

The main thread ages, one request at a time.  A second thread reads stdin and answers everything
else at once, so that a run can be cancelled.  The process ends when it is asked to, after a time
without a run, and when stdin closes, which it does however Blender ended.
"""

from __future__ import annotations

import json
import os
import queue
import sys
import threading
import traceback
from collections.abc import Mapping
from typing import Any, TextIO

from . import __version__
from .errors import Cancelled, TvbrdfError
from .request import MissingLibraryError, cards, load_age, request_from

__all__ = ("IDLE_MINUTES", "PROTOCOL", "Server", "claim_stdout", "serve")

PROTOCOL = 1
IDLE_MINUTES = 10.0

# How long a run may take to notice that stdin has closed before the process ends under it.
GRACE_SECONDS = 20.0


class Server:
    """Answers the requests that come in on `requests` with lines on `replies`.

    `idle_seconds` is how long it waits for a next run before it ends.
    """

    def __init__(self, *, requests: TextIO, replies: TextIO, idle_seconds: float) -> None:
        self._requests = requests
        self._replies = replies
        self._idle_seconds = idle_seconds
        self._reply_lock = threading.Lock()
        self._runs: queue.Queue[_Run | None] = queue.Queue()
        # Guards `_run`, the run that is going on or about to begin.
        self._run_lock = threading.Lock()
        self._run: _Run | None = None

    def serve(self) -> None:
        """Announce readiness, then age what is asked for until there is a reason to end."""
        self._reply({"type": "ready", "protocol": PROTOCOL, "version": __version__})
        threading.Thread(target=self._read, name="requests", daemon=True).start()
        _warm_up()
        while True:
            try:
                run = self._runs.get(timeout=self._idle_seconds)
            except queue.Empty:
                return
            if run is None:
                return
            self._age(run)

    def _read(self) -> None:
        for line in self._requests:
            if line.strip() and not self._handle(line):
                break
        self._end()

    def _handle(self, line: str) -> bool:
        """Answer one request or queue its run; False where it was the last one."""
        try:
            request = json.loads(line)
            request_id, verb = request["id"], request["verb"]
            args = request.get("args") or {}
            if not isinstance(args, dict):
                raise TypeError(args)
        except (ValueError, KeyError, TypeError, AttributeError):
            self._reply_error(None, "protocol", f"This is not a request: {line.strip()[:200]}")
            return True
        match verb:
            case "age":
                self._accept(_Run(self, request_id, args))
            case "cancel":
                self._cancel(args.get("id"))
                self._reply({"id": request_id, "type": "done", "result": {}})
            case "info":
                self._answer_info(request_id, args)
            case "shutdown":
                self._reply({"id": request_id, "type": "done", "result": {}})
                return False
            case _:
                self._reply_error(request_id, "protocol", f"There is no verb {verb!r}.")
        return True

    def _accept(self, run: _Run) -> None:
        with self._run_lock:
            if self._run is not None:
                self._reply_error(
                    run.request_id,
                    "busy",
                    "The worker is busy with another run.",
                    "Wait for it to end, or cancel it.",
                )
                return
            self._run = run
        self._runs.put(run)

    def _cancel(self, request_id: Any) -> None:
        with self._run_lock:
            if self._run is not None and request_id in (None, self._run.request_id):
                self._run.cancel()

    def _answer_info(self, request_id: Any, args: Mapping[str, Any]) -> None:
        try:
            self._reply({"id": request_id, "type": "done", "result": cards(args.get("ntm"))})
        except TvbrdfError as error:
            self._reply_error(request_id, error.code, error.message, error.hint)

    def _end(self) -> None:
        self._cancel(None)
        self._runs.put(None)
        # Neither a run that is deep in one long computation nor the import of torch may keep it.
        with self._run_lock:
            patience = GRACE_SECONDS if self._run is not None else 0.0
        timer = threading.Timer(patience, os._exit, args=(0,))
        timer.daemon = True
        timer.start()

    def _age(self, run: _Run) -> None:
        try:
            reply = {"type": "done", "result": run.age()}
        except TvbrdfError as error:
            reply = _error(error.code, error.message, error.hint)
        except MemoryError:
            reply = _error(
                "memory",
                "There is not enough memory for this run.",
                "Choose a smaller size or fewer frames.",
            )
        except Exception as error:
            traceback.print_exc()
            reply = _error(
                "internal",
                f"Something went wrong inside the worker: {type(error).__name__}: {error}",
                "The system console shows the details; please report them.",
            )
        with self._run_lock:
            self._run = None
        self._reply({"id": run.request_id} | reply)

    def _reply_error(self, request_id: Any, code: str, message: str, hint: str = "") -> None:
        self._reply({"id": request_id} | _error(code, message, hint))

    def _reply(self, message: Mapping[str, Any]) -> None:
        with self._reply_lock:
            try:
                self._replies.write(json.dumps(message) + "\n")
                self._replies.flush()
            except (BrokenPipeError, ValueError):
                # Nobody listens any more: stdin closes as well, which ends the process.
                return


class _Run:
    """One `age` request, and the reporter that it gives to `age`."""

    def __init__(self, server: Server, request_id: Any, args: Mapping[str, Any]) -> None:
        self.request_id = request_id
        self._server = server
        self._args = args
        self._cancelled = threading.Event()

    def age(self) -> dict[str, Any]:
        age = load_age()
        if self.cancelled():
            raise Cancelled
        return age(request_from(self._args), self)

    def cancel(self) -> None:
        self._cancelled.set()

    def progress(self, stage: str, fraction: float) -> None:
        self._server._reply(
            {"id": self.request_id, "type": "progress", "stage": stage, "fraction": fraction}
        )

    def warning(self, message: str) -> None:
        self._server._reply({"id": self.request_id, "type": "warning", "message": message})

    def cancelled(self) -> bool:
        return self._cancelled.is_set()


def serve(*, idle_seconds: float) -> None:
    """Serve on this process's stdin and stdout, keeping both from everything else in it.

    A library that prints, or a child that reads, must not get between the messages.
    """
    replies = claim_stdout()
    requests = os.fdopen(os.dup(0), "r", encoding="utf-8", errors="replace")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    Server(requests=requests, replies=replies, idle_seconds=idle_seconds).serve()
    # Not sys.exit: the reading thread may hold `requests`, whose lock the shutdown would wait for.
    sys.stderr.flush()
    os._exit(0)


def claim_stdout() -> TextIO:
    """This process's stdout, for the caller alone: what anything else prints goes to stderr."""
    sys.stdout.flush()
    claimed = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return claimed


def _warm_up() -> None:
    """Import torch before the first run; what stands in the way is told when there is one."""
    try:
        load_age()
    except MissingLibraryError as error:
        print(error, file=sys.stderr)


def _error(code: str, message: str, hint: str) -> dict[str, Any]:
    return {"type": "error", "code": code, "message": message, "hint": hint}
