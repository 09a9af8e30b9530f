"""`python -m training learn`: for people, and with --json for programs, such as Blender.

With --json stdout has one JSON object a line, those of the worker (`model_runtime.messages`):
progress, warnings, and at the end `done` with the model's card or an error; and `{"verb":
"cancel"}` on stdin ends the run. Exit codes are those of `model_runtime`: 0 done, 1 failed with a
reason, 2 wrong usage, 128 and its number for a signal; 3 cancelled.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO, TextIO

from model_runtime.console import Parser, Terminal, fill_closed_streams, log_of, say, write_out
from model_runtime.contract import NEEDS_TORCH, TORCH
from model_runtime.errors import Cancelled, TvbrdfError, UsageError, reason
from model_runtime.memory import check_limits, memory_in_words
from model_runtime.messages import Done, Failed, Message, Notice, Progress, Reply, Request
from model_runtime.request import MissingLibraryError
from model_runtime.serve import claim_stdout
from model_runtime.signals import EndedBySignal, EndingSignals

__all__ = ("CANCELLED", "main")

CANCELLED = 3
"""The exit code of a run that was told to end."""

_MOST_MINUTES = 1e6
_LONGEST_LINE = 1 << 16


def main(argv: Sequence[str]) -> int:
    """Run the command with these arguments; its exit code."""
    ending = EndingSignals()
    try:
        ending.heed()
        return _run(argv, ending)
    except EndedBySignal as end:
        say("training: Interrupted; nothing is left half-written.")
        return end.exit_code
    finally:
        ending.ignore()


def _run(argv: Sequence[str], ending: EndingSignals) -> int:
    fill_closed_streams()
    try:
        arguments = _parser().parse_args(argv)
    except SystemExit as end:  # argparse has said why
        return int(end.code or 0)
    stdout = claim_stdout()
    listener = _Lines(stdout) if arguments.json else _Person(Terminal(ending), stdout)
    try:
        with memory_in_words("Close other programs."):
            check_limits()
            _require_torch()
            card = _learn(arguments, listener)
    except Cancelled as cancelled:
        listener.failed(cancelled)
        return 128 + ending.received if ending.received else CANCELLED
    except TvbrdfError as error:
        listener.failed(error)
        return 2 if isinstance(error, UsageError) else 1
    except Exception as error:
        listener.lost(error)
        return 1
    listener.done(arguments.output, card)
    return 0


def _require_torch() -> None:
    from model_runtime.backend import NAME

    if NAME != TORCH:
        raise MissingLibraryError(*NEEDS_TORCH)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="python -m training learn",
        description="Learns how a material weathers from one that is weathered in places.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "source",
        type=Path,
        help="folder of texture maps, image, time-lapse, or folder of a sequence",
    )
    parser.add_argument("--output", type=Path, required=True, metavar="FILE", help=".safetensors")
    parser.add_argument("--name", required=True, help="short name, for --ntm")
    parser.add_argument("--process", default="", metavar="P", help="rust, moss, ...: how it grows")
    parser.add_argument("--mask", type=Path, metavar="IMAGE", help="white where it is weathered")
    parser.add_argument("--title", default="", help="what menus show")
    parser.add_argument("--description", default="", help="a sentence for the artist")
    parser.add_argument("--license", default="", help="of the model")
    parser.add_argument("--source-license", default="", help="of what it is learned from")
    parser.add_argument("--credit", default="", help="whose work that is")
    parser.add_argument("--minutes", type=float, metavar="M", help="that the networks may take")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of all random numbers")
    parser.add_argument("--json", action="store_true", help="tell of it in JSON, one object a line")
    return parser


def _learn(arguments: argparse.Namespace, listener: _Person | _Lines) -> dict[str, Any]:
    minutes, seed = arguments.minutes, arguments.seed
    if minutes is not None and not 0 < minutes <= _MOST_MINUTES:
        raise UsageError(f"A training of {minutes:g} minutes makes no sense.", "Give a few.")
    if not 0 <= seed < 1 << 63:
        raise UsageError("The seed is out of range.", "Give a whole number from 0.")
    listener.step("Starting", 0.0)
    from .learn import learn  # torch takes seconds

    source = arguments.source
    work = {
        "name": source.resolve().stem,
        "license": arguments.source_license,
        "credit": arguments.credit,
    }
    return learn(
        source,
        arguments.output,
        arguments.name,
        process=arguments.process,
        title=arguments.title,
        description=arguments.description,
        mask=arguments.mask,
        license=arguments.license,
        sources=(work,) if work["license"] or work["credit"] else (),
        minutes=minutes,
        seed=seed,
        step=listener.step,
        command=_command(arguments),
    )


def _command(arguments: argparse.Namespace) -> str:
    """What repeats it, without the folders of whoever ran it."""
    words = [f"python -m training learn {arguments.source.name} --output {arguments.output.name}"]
    for name in ("name", "process", "minutes", "seed"):
        value = getattr(arguments, name)
        if value not in ("", None):
            words.append(f"--{name} {value}")
    return " ".join(words)


class _Person:
    """Tells somebody at a terminal."""

    def __init__(self, terminal: Terminal, stdout: TextIO) -> None:
        self._terminal, self._stdout = terminal, stdout

    def step(self, stage: str, fraction: float) -> None:
        if self._terminal.cancelled():
            raise Cancelled
        self._terminal.progress(stage, fraction)

    def failed(self, error: TvbrdfError) -> None:
        self._terminal.close()
        say(f"training: {error}")

    def lost(self, error: Exception) -> None:
        self._terminal.close()
        say(f"training: This should not happen ({type(error).__name__}). {log_of(error)}")

    def done(self, output: Path, card: dict[str, Any]) -> None:
        self._terminal.close()
        for warning in card["warnings"]:
            say(f"Warning: {warning}")
        write_out(f"{output}: {card['source']}", self._stdout)


class _Lines:
    """Tells a program, and hears from it on stdin whether to go on."""

    def __init__(self, stdout: TextIO) -> None:
        self._stdout = stdout
        self._cancelled = threading.Event()
        requests = os.fdopen(os.dup(0), "rb")
        threading.Thread(target=self._listen, args=(requests,), daemon=True).start()

    def _listen(self, requests: BinaryIO) -> None:
        while line := requests.readline(_LONGEST_LINE):
            request = Request.read(line)
            if request is not None and request.verb in ("cancel", "shutdown"):
                self._cancelled.set()

    def _say(self, message: Message) -> None:
        try:
            print(Reply(message, "learn").line(), file=self._stdout, flush=True)
        except (OSError, ValueError):
            self._cancelled.set()  # nobody listens any more

    def step(self, stage: str, fraction: float) -> None:
        if self._cancelled.is_set():
            raise Cancelled
        self._say(Progress(stage, fraction))

    def failed(self, error: TvbrdfError) -> None:
        self._say(Failed(error.code, error.message, error.hint))

    def lost(self, error: Exception) -> None:
        traceback.print_exception(error, file=sys.stderr)
        said = f"This should not happen ({type(error).__name__}: {reason(error)})."
        details = "".join(traceback.format_exception(error))
        self._say(Failed("internal", said, "", details))

    def done(self, output: Path, card: dict[str, Any]) -> None:
        for warning in card["warnings"]:
            self._say(Notice(warning))
        self._say(Done(card))
