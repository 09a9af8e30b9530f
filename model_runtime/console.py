"""What the command line says, wherever stdout and stderr lead: to a terminal, a file, a pipe that
nobody reads, a full disk or nowhere.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import traceback
from pathlib import Path
from typing import NoReturn, TextIO

from .errors import OutputError, shown
from .signals import EndingSignals

__all__ = ("Parser", "Terminal", "fill_closed_streams", "flush", "log_of", "say", "write_out")

_LONGEST = 300  # characters of what argparse says


def fill_closed_streams() -> bool:
    """Let what is closed of stdin, stdout and stderr lead nowhere; whether stdout was closed.

    The first file to be opened would take its place, and what is printed would end in it.
    """
    closed = [number for number in range(3) if not _is_open(number)]
    for _ in closed:
        os.open(os.devnull, os.O_RDWR)
    if sys.stdout is None:
        sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    return 1 in closed


def say(text: str, end: str = "\n") -> None:
    """Print `text` on stderr.  Where that cannot be done nobody can be told."""
    try:
        print(text, end=end, file=sys.stderr, flush=True)
    except (OSError, ValueError):
        _silence(sys.stderr)


def write_out(text: str, stdout: TextIO) -> None:
    """Print `text` on `stdout`, in escapes where its encoding lacks a character.

    Raises OutputError where that cannot be done, and SystemExit where its reader has left, as
    `head` does: it needs no sentence.
    """
    text = text.encode(stdout.encoding, "backslashreplace").decode(stdout.encoding)
    try:
        print(text, file=stdout, flush=True)
    except OSError as error:
        _silence(stdout)
        if isinstance(error, BrokenPipeError):
            raise SystemExit(1) from error
        raise OutputError(
            f"Standard output cannot be written ({error.strerror}).",
            "Let it lead to a file or a program that takes it.",
        ) from error


def flush() -> None:
    """Write what libraries have printed, so that Python need not when it ends, and complain."""
    try:
        sys.stdout.flush()
    except OSError:
        _silence(sys.stdout)


def log_of(error: BaseException) -> str:
    """Write how `error` came about to a file of its own; returns a sentence that names it."""
    try:
        descriptor, path = tempfile.mkstemp(prefix="tvbrdf-", suffix=".log")
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            traceback.print_exception(error, file=file)
    except OSError:
        return "Please report it with the command that you ran."
    return f"Please report it with the command that you ran and the file {path}."


class Parser(argparse.ArgumentParser):
    """Quotes what it was given plainly and in part, whatever that is."""

    def error(self, message: str) -> NoReturn:
        super().error(shown(message, most=_LONGEST))


class Terminal:
    """Reports to stderr: one line that is written over on a terminal, a line a stage elsewhere."""

    def __init__(self, ending: EndingSignals) -> None:
        self._ending = ending
        self._line_open = False
        self._last_stage = ""

    def progress(self, stage: str, fraction: float) -> None:
        if sys.stderr.isatty():
            say(f"\r{fraction:5.0%}  {stage:<40}", end="")
            self._line_open = True
        elif stage != self._last_stage:
            say(f"{fraction:5.0%}  {stage}")
        self._last_stage = stage

    def warning(self, message: str) -> None:
        self.close()
        say(f"Warning: {message}")

    def cancelled(self) -> bool:
        # What a signal raises is lost where it meets a finalizer.
        return self._ending.received is not None

    def close(self) -> None:
        if self._line_open:
            say("")
            self._line_open = False


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def _silence(stream: TextIO) -> None:
    """Let `stream` lead nowhere: what it could not write it would try to write again at the end."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, stream.fileno())
    os.close(nothing)
