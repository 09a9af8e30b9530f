"""The command line, `python -m model_runtime age | info | serve`: a thin shell over `age`.

Exit codes: 0 done, 1 failed with a reason, 2 wrong usage, 128 and its number for a signal (Ctrl-C:
130).  Nothing here imports torch before a run is asked for.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from . import serve
from .console import Parser, Terminal, fill_closed_streams, flush, log_of, say, write_out
from .contract import (
    AUTO,
    CACHE,
    CACHE_GIGABYTES,
    CACHE_GIGABYTES_OPTION,
    CACHE_OPTION,
    CACHE_SECONDS,
    CHOICES,
    CPU,
    DEVICES,
    EVERYWHERE,
    EXPOSURES,
    IDLE_MINUTES,
    IDLE_OPTION,
    LIVE,
    RANGES,
    REPORT,
    SERVE,
    AgeRequest,
    option,
)
from .errors import Cancelled, OutputError, TvbrdfError, UsageError
from .memory import memory_in_words
from .output.kept import Kept
from .request import cards, load_age, request_from
from .signals import EndedBySignal, EndingSignals

__all__ = ("main",)

_MOST_IDLE_MINUTES = 525_600.0  # a year


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; the exit code."""
    ending = EndingSignals()
    try:
        ending.heed()
        code = _run(argv, ending)
    except (EndedBySignal, Cancelled):
        say("model_runtime: Interrupted; nothing is left half-written.")
        code = 128 + (ending.received or 0)
    ending.ignore()  # what is left to do takes no time, and all is written
    flush()
    return code


def _run(argv: Sequence[str] | None, ending: EndingSignals) -> int:
    stdout_is_closed = fill_closed_streams()
    try:
        arguments = _parser().parse_args(argv)
        if stdout_is_closed and getattr(arguments, "json", False):
            raise OutputError("Standard output is closed.", "--json needs one to print on.")
        with memory_in_words("Close other programs."):
            arguments.run(arguments, ending)
    except SystemExit as end:  # of argparse, which has said why; or nobody listens any more
        return int(end.code or 0)
    except Cancelled:
        raise
    except TvbrdfError as error:
        say(f"model_runtime: {error}")
        return 2 if isinstance(error, UsageError) else 1
    except Exception as error:
        say(f"model_runtime: This should not happen ({type(error).__name__}). {log_of(error)}")
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="python -m model_runtime", description="Ages materials with neural temporal models."
    )
    commands = parser.add_subparsers(required=True, metavar="age | info | serve")

    age = commands.add_parser("age", help="age one material", allow_abbrev=False)
    _add_age_options(age)
    _add_cache_options(age)
    age.set_defaults(run=_age)

    info = commands.add_parser("info", help="list the models", allow_abbrev=False)
    info.add_argument("--ntm", metavar="NAME_OR_FILE", help="only this one")
    info.add_argument("--json", action="store_true", help="print the cards as a JSON list")
    info.set_defaults(run=_info)

    worker = commands.add_parser(SERVE, help="answer JSON requests, one a line, on stdin")
    worker.add_argument(
        IDLE_OPTION,
        type=float,
        default=IDLE_MINUTES,
        metavar="M",
        help=f"end after so long without a run ({IDLE_MINUTES:g})",
    )
    _add_cache_options(worker)
    worker.set_defaults(run=_serve)
    return parser


def _add_age_options(age: argparse.ArgumentParser) -> None:
    usual = AgeRequest
    age.add_argument(
        "--input",
        required=True,
        metavar="PATH",
        help="folder of texture maps, or of kd.exr ks.exr alpha.exr; MERL .binary; RGL .bsdf",
    )
    age.add_argument("--ntm", required=True, metavar="NAME_OR_FILE", help="neural temporal model")
    age.add_argument("--output", required=True, metavar="DIR", help="folder for the aged maps")
    age.add_argument(
        "--frames",
        type=int,
        metavar="N",
        help=f"frames from t = 0 to 1, up to {RANGES['frames'][1]} ({usual.frames})",
    )
    age.add_argument("--size", type=int, metavar="PX", help="longer side (as the input)")
    age.add_argument(
        "--tolerance",
        type=float,
        metavar="DB",
        help=f"what may be left out ({usual.tolerance:g})",
    )
    age.add_argument(
        "--onset", metavar=f"{AUTO}|{EVERYWHERE}|IMAGE", help=f"when each texel starts ({AUTO})"
    )
    age.add_argument(
        "--seed", type=int, metavar="N", help=f"seed of the onset pattern ({usual.seed})"
    )
    age.add_argument("--surface", metavar="DIR", help="folder of position.exr and normal.exr, ...")
    age.add_argument(
        "--timing-apart",
        action="store_true",
        help="lay timing out as the surface is, and the rest as the maps are, which may repeat",
    )
    age.add_argument(
        "--exposure", metavar="NAME=WEIGHT,...", help=f"what it seeks: {', '.join(EXPOSURES)}"
    )
    age.add_argument("--starts", metavar="X,Y,Z;...", help="places in the world where it starts")
    age.add_argument("--mask", metavar="IMAGE", help="what is painted, laid out as the surface is")
    age.add_argument(
        "--light",
        metavar="IMAGE",
        help="ages by the light that falls on each texel, laid out likewise",
    )
    age.add_argument("--pattern-size", type=float, metavar="METERS", help="of its patches")
    age.add_argument(
        "--amount",
        type=float,
        metavar="SHARE",
        help=f"of the surface that changes ({usual.amount:g})",
    )
    age.add_argument(
        "--grain", type=float, metavar="SHARE", help=f"of what texels differ by ({usual.grain:g})"
    )
    age.add_argument("--device", metavar=DEVICES, help=f"what computes ({usual.device})")
    for name, choices in CHOICES.items():
        age.add_argument(option(name), metavar="|".join(choices))
    age.add_argument("--sparse", action="store_true", help="store no frame that others make up")
    age.add_argument("--json", action="store_true", help=f"print {REPORT} on stdout")


def _add_cache_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        CACHE_OPTION,
        metavar="DIR",
        default=os.environ.get(CACHE),
        help=f"keep results there, and take from there what is the very same ({CACHE}, or none)",
    )
    command.add_argument(
        CACHE_GIGABYTES_OPTION,
        type=float,
        default=CACHE_GIGABYTES,
        metavar="GB",
        help=f"as much as is kept ({CACHE_GIGABYTES:g})",
    )


def _kept(arguments: argparse.Namespace) -> Kept | None:
    if not 0 <= arguments.cache_gb < math.inf:
        raise UsageError(f"{CACHE_GIGABYTES_OPTION} must be a number of gigabytes, 0 or more.")
    if not arguments.cache or not arguments.cache_gb:
        return None
    return Kept(Path(arguments.cache).absolute(), arguments.cache_gb * 1e9)


def _age(arguments: argparse.Namespace, ending: EndingSignals) -> None:
    names = {field.name for field in dataclasses.fields(AgeRequest)}
    fields = {name: value for name, value in vars(arguments).items() if name in names}
    stdout = serve.claim_stdout()
    age = load_age(_kept(arguments))
    reporter = Terminal(ending)
    try:
        aged = age(request_from(fields), reporter)
    finally:
        reporter.close()
    if arguments.json:
        write_out(json.dumps(aged, indent=2), stdout)
        return
    seconds = aged.get(CACHE_SECONDS, sum(aged["seconds"].values()))
    height, width = aged["size"]
    what = "A live material" if aged["binding"] == LIVE else f"{aged['frames']} frames"
    on = "" if aged["device"] == CPU else f" on {aged['device']}"
    how = " from the cache" if CACHE_SECONDS in aged else on
    done = f"{what} of {width} x {height} in {seconds:.1f} s{how}: {arguments.output}"
    write_out("\n".join((*aged["plan"], done)), stdout)


def _info(arguments: argparse.Namespace, _ending: EndingSignals) -> None:
    found = cards(arguments.ntm, skipped=lambda error: say(f"Skipped: {error}"))
    if arguments.json:
        write_out(json.dumps(found, indent=2), sys.stdout)
        return
    lines = (f"{card['name']:12} {card['title']}: {card['summary']}" for card in found)
    write_out("\n".join(lines), sys.stdout)


def _serve(arguments: argparse.Namespace, _ending: EndingSignals) -> None:
    if not 0 < arguments.idle_minutes <= _MOST_IDLE_MINUTES:
        raise UsageError(f"{IDLE_OPTION} must be more than 0 and at most {_MOST_IDLE_MINUTES:.0f}.")
    try:
        serve.serve(idle_seconds=arguments.idle_minutes * 60, kept=_kept(arguments))
    except EndedBySignal as end:
        os._exit(end.exit_code)  # as `serve` ends
