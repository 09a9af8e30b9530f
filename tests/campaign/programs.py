"""The programs under test: children that answer line for line and stay warm, and single commands.

A warm worker imports torch once for hundreds of trials.  What each trial needed of memory is known
nevertheless: Linux forgets a process's peak when it is asked to.
"""

from __future__ import annotations

import json
import os
import queue
import re
import resource
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from .evidence import Answer, Ended

__all__ = ("ROOT", "Child", "Gone", "Watch", "Worker", "command")

ROOT = Path(__file__).resolve().parents[2]
# What no run needs, and the machine can spare.
_MOST_BYTES = 4 << 30
_START_SECONDS = 60.0
_ABSENT = {"id": 0, "verb": "age", "args": {"input": "/absent", "ntm": "rust", "output": "/absent"}}
_PROGRESS = re.compile(r"\s*\d+%  \S.*|\s*")
_SENTENCE = re.compile(
    r"Warning: |model_runtime: |python -m model_runtime[^:]*: error: |usage: python -m|  +[^ ]"
)

_Lines = queue.SimpleQueue[bytes | None]
Watch = Callable[[int, float], signal.Signals | None]
"""Looks at a running command's process id and seconds, again and again, until it names the signal
to send."""


class Gone(Exception):  # noqa: N818
    """The child has ended."""


class Child:
    """A process that answers lines with lines; started when it is needed and not there."""

    def __init__(self, *words: str, home: Path) -> None:
        self._words = (sys.executable, *words)
        self._home = home
        self._log = home.with_name(f"{home.name}.log")
        self._process: subprocess.Popen[bytes] | None = None
        self._lines: _Lines = queue.SimpleQueue()
        self._unsent: _Lines = queue.SimpleQueue()

    def send(self, line: bytes) -> None:
        """Send a line, to a fresh process where there is none; does not wait until it is read."""
        _ = self.process
        self._unsent.put(line + b"\n")

    def receive(self, until: float) -> dict[str, Any] | None:
        """The next line; None where none comes before the clock shows `until`. Raises Gone."""
        try:
            line = self._lines.get(timeout=max(0.0, until - time.monotonic()))
        except queue.Empty:
            return None
        if line is None:
            raise Gone(self.end())
        try:
            return json.loads(line)
        except ValueError as error:
            self.end()
            raise Gone(f"a line that is not JSON: {line[:100]!r}") from error

    @property
    def process(self) -> subprocess.Popen[bytes]:
        if self._process is None:
            self._home.mkdir(parents=True, exist_ok=True)
            self._log.unlink(missing_ok=True)
            with self._log.open("ab") as log:
                self._process = subprocess.Popen(
                    self._words,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=log,
                    cwd=self._home,
                    env=_environment(self._home),
                )
            resource.prlimit(self._process.pid, resource.RLIMIT_DATA, (_MOST_BYTES, _MOST_BYTES))
            self._lines, self._unsent = queue.SimpleQueue(), queue.SimpleQueue()
            for pump, lines in ((_read, self._lines), (_write, self._unsent)):
                threading.Thread(target=pump, args=(self._process, lines), daemon=True).start()
        return self._process

    def forget_peak(self) -> None:
        Path(f"/proc/{self.process.pid}/clear_refs").write_text("5")

    def peak_mb(self) -> float:
        """The most memory held since `forget_peak`; 0 where the process has ended."""
        return _peak_mb(self.process.pid)

    def log(self) -> str:
        """What it wrote to stderr since the last call."""
        with self._log.open("r+b") as log:
            text = log.read().decode(errors="replace")
            log.truncate(0)
        return text

    def end(self, *, closing: bool = False, seconds: float = 0.0) -> str:
        """End it, by closing its stdin where `closing`; how it ended within `seconds`."""
        if self._process is None:
            return "not started"
        process, self._process = self._process, None
        self._unsent.put(None)
        try:
            code = process.wait(timeout=seconds if closing else 0.2)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return "still running"
        return f"exit code {code}"


class Worker(Child):
    """`python -m model_runtime serve`, warm: torch is imported before the first trial."""

    def __init__(self, home: Path) -> None:
        super().__init__("-m", "model_runtime", "serve", home=home)
        self._count = 0

    @property
    def process(self) -> subprocess.Popen[bytes]:
        cold = self._process is None
        process = super().process
        if cold:
            until = time.monotonic() + _START_SECONDS
            self.send(json.dumps(_ABSENT).encode())
            while (reply := self.receive(until)) is not None and reply["type"] != "error":
                pass
            self.log()
        return process

    def ask(self, verb: str, args: Mapping[str, Any], *, seconds: float) -> Answer:
        """The answer to one request, which may take `seconds`."""
        self.forget_peak()
        self._count += 1
        request = {"id": self._count, "verb": verb, "args": args}
        words: list[str] = []
        started = time.monotonic()
        try:
            self.send(json.dumps(request).encode())
            while (reply := self.receive(started + seconds)) is not None:
                if reply.get("id") != self._count or reply["type"] == "progress":
                    continue
                if reply["type"] == "warning":
                    words.append(reply["message"])
                    continue
                return self._answer(reply, words, time.monotonic() - started)
        except Gone as gone:
            return Answer("died", str(gone), log=self.log(), seconds=time.monotonic() - started)
        self.end()
        return Answer("hung", log=self.log(), seconds=time.monotonic() - started)

    def _answer(self, reply: Mapping[str, Any], words: list[str], seconds: float) -> Answer:
        ended: Ended = "done"
        if reply["type"] == "error":
            ended = "stopped" if reply["code"] == "cancelled" else "refused"
            words = [f"{reply['message']} {reply['hint']}".strip(), *words]
        return Answer(
            ended,
            str(reply.get("code", "")),
            tuple(words),
            log=(log := self.log()),
            noise=log,
            seconds=seconds,
            peak_mb=self.peak_mb(),
            result=reply.get("result") or {},
        )


def command(
    words: Sequence[str],
    *,
    home: Path,
    logs: Path,
    seconds: float,
    module: str = "model_runtime",
    shell: str = "",
    stdout: int | None = None,
    watch: Watch | None = None,
) -> Answer:
    """Run `python -m module words`; `shell` is what bash does before (`ulimit`, `exec 1>&-`).

    `stdout` is a file descriptor, by default of a file in `logs`, where stderr goes. A command that
    does not end within `seconds` is killed with all that it started.
    """
    home.mkdir(parents=True, exist_ok=True)
    line = shlex.join([sys.executable, "-m", module, *words])
    sent: signal.Signals | None = None
    out, err = (logs / name for name in ("stdout", "stderr"))
    started = time.monotonic()
    with out.open("wb") as plain, err.open("wb") as log:
        process = subprocess.Popen(
            ["/bin/bash", "-c", f"{shell}\nexec {line}"],
            stdin=subprocess.DEVNULL,
            stdout=plain if stdout is None else stdout,
            stderr=log,
            cwd=home,
            env=_environment(home),
            start_new_session=True,
        )
    peak_mb, hung = 0.0, False
    while process.poll() is None and not hung:
        elapsed = time.monotonic() - started
        # What wait4 tells begins with what this process held when it started the other.
        peak_mb = max(peak_mb, _peak_mb(process.pid))
        if hung := elapsed > seconds:
            os.killpg(process.pid, signal.SIGKILL)
        if watch is not None and sent is None and (sent := watch(process.pid, elapsed)):
            os.kill(process.pid, sent)
        time.sleep(0.001 if watch else 0.01)
    seconds, code = time.monotonic() - started, process.wait()
    return _answer_of(
        None if hung else code,
        sent,
        log=err.read_text(errors="replace"),
        said=out.read_text(errors="replace"),
        seconds=seconds,
        peak_mb=peak_mb,
    )


def _answer_of(
    code: int | None, sent: signal.Signals | None, *, log: str, said: str, **measured: float
) -> Answer:
    """The answer in a command's exit code (None: it had to be killed), stderr and stdout."""
    lines = [line for line in log.split("\n") if not _PROGRESS.fullmatch(line)]
    noise = "\n".join(line for line in lines if not _SENTENCE.match(line))
    ended: Ended = "died"
    if code is None:
        ended = "hung"
    elif code == 0:
        ended = "done"
    elif sent is not None and code in (-sent, 128 + sent):
        ended = "stopped"
    elif code in (1, 2):
        ended = "refused"
    words = (*lines, *([] if said.startswith(("{", "[")) else said.split("\n")))
    return Answer(ended, str(code), words, log=log, noise=noise, **measured)


def _peak_mb(process: int) -> float:
    """The most memory that a process has held; 0 where it has ended."""
    try:
        status = Path(f"/proc/{process}/status").read_text()
        return int(status.partition("VmHWM:")[2].split()[0]) / 1024
    except (OSError, IndexError):
        return 0.0


def _environment(home: Path) -> dict[str, str]:
    """Where a program is led to put whatever it puts elsewhere."""
    places = dict.fromkeys(("HOME", "TMPDIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"), str(home))
    return os.environ | places | {"PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(ROOT)}


def _read(process: subprocess.Popen[bytes], lines: _Lines) -> None:
    assert process.stdout is not None
    with process.stdout:
        for line in process.stdout:
            lines.put(line)
    lines.put(None)


def _write(process: subprocess.Popen[bytes], lines: _Lines) -> None:
    assert process.stdin is not None
    with suppress(OSError), process.stdin:  # it may end before it has read all
        while (line := lines.get()) is not None:
            process.stdin.write(line)
            process.stdin.flush()
