"""The command line, `python -m model_runtime age | info | serve`: a thin shell over `age`.

Exit codes: 0 done, 1 failed with a reason, 2 wrong usage.  Nothing here imports torch before a run
is asked for.
"""

from __future__ import annotations

import argparse
import json
import sys
import traceback
from collections.abc import Sequence

from . import serve
from .errors import TvbrdfError, UsageError
from .request import CHOICES, cards, load_age, option, request_from

__all__ = ("main",)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; the exit code."""
    arguments = _parser().parse_args(argv)
    try:
        arguments.run(arguments)
    except TvbrdfError as error:
        print(f"model_runtime: {error}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    except KeyboardInterrupt:
        print("model_runtime: Interrupted; the earlier result is untouched.", file=sys.stderr)
        return 1
    except Exception as error:
        traceback.print_exc()
        print(f"model_runtime: {type(error).__name__}: {error}", file=sys.stderr)
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m model_runtime", description="Ages materials with neural temporal models."
    )
    commands = parser.add_subparsers(required=True, metavar="age | info | serve")

    age = commands.add_parser("age", help="age one material", allow_abbrev=False)
    age.add_argument(
        "--input",
        required=True,
        metavar="PATH",
        help="folder of texture maps, or of kd.exr ks.exr alpha.exr; MERL .binary; RGL .bsdf",
    )
    age.add_argument("--ntm", required=True, metavar="NAME_OR_FILE", help="neural temporal model")
    age.add_argument("--output", required=True, metavar="DIR", help="folder for the aged maps")
    age.add_argument("--frames", type=int, metavar="N", help="frames from t = 0 to 1 (36)")
    age.add_argument("--size", type=int, metavar="PX", help="longer side (as the input)")
    age.add_argument("--tolerance", type=float, metavar="DB", help="what may be left out (45)")
    age.add_argument("--onset", metavar="auto|none|IMAGE", help="when each texel starts (auto)")
    age.add_argument("--seed", type=int, metavar="N", help="seed of the onset pattern (0)")
    for name, choices in CHOICES.items():
        age.add_argument(option(name), metavar="|".join(choices))
    age.add_argument("--sparse", action="store_true", help="store no frame that others make up")
    age.add_argument("--json", action="store_true", help="print aged.json on stdout")
    age.set_defaults(run=_age)

    info = commands.add_parser("info", help="list the models", allow_abbrev=False)
    info.add_argument("--ntm", metavar="NAME_OR_FILE", help="only this one")
    info.add_argument("--json", action="store_true", help="print the cards as a JSON list")
    info.set_defaults(run=_info)

    worker = commands.add_parser("serve", help="answer JSON requests, one a line, on stdin")
    worker.add_argument(
        "--idle-minutes",
        type=float,
        default=serve.IDLE_MINUTES,
        metavar="M",
        help=f"end after so long without a run ({serve.IDLE_MINUTES:g})",
    )
    worker.set_defaults(run=_serve)
    return parser


def _age(arguments: argparse.Namespace) -> None:
    fields = {k: v for k, v in vars(arguments).items() if k not in ("run", "json")}
    stdout = serve.claim_stdout()
    age = load_age()
    reporter = _Terminal()
    try:
        aged = age(request_from(fields), reporter)
    finally:
        reporter.close()
    if arguments.json:
        print(json.dumps(aged, indent=2), file=stdout, flush=True)
        return
    seconds = sum(aged["seconds"].values())
    height, width = aged["size"]
    done = f"{aged['frames']} frames of {width} x {height} in {seconds:.1f} s: {arguments.output}"
    print(*aged["plan"], done, sep="\n", file=stdout, flush=True)


def _info(arguments: argparse.Namespace) -> None:
    found = cards(arguments.ntm, skipped=lambda error: print(f"Skipped: {error}", file=sys.stderr))
    if arguments.json:
        print(json.dumps(found, indent=2))
        return
    for card in found:
        print(f"{card['name']:12} {card['title']}: {card['description']}")


def _serve(arguments: argparse.Namespace) -> None:
    if not arguments.idle_minutes > 0:
        raise UsageError("--idle-minutes must be a positive number.")
    serve.serve(idle_seconds=arguments.idle_minutes * 60)


class _Terminal:
    """Reports to stderr: one line that is written over on a terminal, a line a stage elsewhere."""

    def __init__(self) -> None:
        self._line_open = False
        self._last_stage = ""

    def progress(self, stage: str, fraction: float) -> None:
        if sys.stderr.isatty():
            print(f"\r{fraction:5.0%}  {stage:<40}", end="", file=sys.stderr, flush=True)
            self._line_open = True
        elif stage != self._last_stage:
            print(f"{fraction:5.0%}  {stage}", file=sys.stderr, flush=True)
        self._last_stage = stage

    def warning(self, message: str) -> None:
        self.close()
        print(f"Warning: {message}", file=sys.stderr, flush=True)

    def cancelled(self) -> bool:
        return False

    def close(self) -> None:
        if self._line_open:
            print(file=sys.stderr)
            self._line_open = False
