"""`python -m tests.campaign --seed N --minutes M`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from .campaign import Campaign
from .kinds import KINDS
from .tally import Tally


def main() -> int:
    """Run a campaign, or one of its trials; 1 where there was a fault, 0 where not."""
    options = _parser().parse_args()
    kinds = options.kinds.split(",") if options.kinds else list(KINDS)
    if options.only:
        return _only(options.only, keep=options.keep)
    minutes = options.minutes or (float("inf") if options.trials else 25.0)
    started = time.monotonic()
    campaign = Campaign(kinds, keep=options.keep)
    try:
        tally = campaign.run(
            seed=options.seed,
            trials=options.trials,
            until=started + 60 * minutes,
            heard=_Ticker(started),
        )
    finally:
        campaign.close()
    words = " ".join(["python -m tests.campaign", *sys.argv[1:]])
    spent = (time.monotonic() - started) / 60
    title = f"`{words}`: {len(tally.verdicts):,} trials in {spent:.0f} minutes."
    text = tally.markdown(title)
    print(text)
    if options.markdown:
        options.markdown.write_text(text, encoding="utf-8")
    if options.json:
        options.json.write_text(json.dumps(tally.json(), indent=1), encoding="utf-8")
    return 1 if tally.faults else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign", description="Tries what can go wrong, and counts."
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of all trials (0)")
    parser.add_argument("--minutes", type=float, metavar="M", help="how long (25)")
    parser.add_argument("--trials", type=int, metavar="T", help="how many at most")
    parser.add_argument("--kinds", metavar="A,B", help=f"only these of {', '.join(KINDS)}")
    parser.add_argument("--only", metavar="KIND:NUMBER", help="one trial, and all that it left")
    parser.add_argument("--keep", action="store_true", help="leave the trials' folders there")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the table there")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write counts and faults there")
    return parser


def _only(name: str, *, keep: bool) -> int:
    kind, _, number = name.rpartition(":")
    campaign = Campaign([kind], lanes=1, keep=keep)
    try:
        verdict, evidence = campaign.only(kind, int(number))
    finally:
        campaign.close()
    for each in evidence:
        answer = each.answer
        print(f"{answer.ended} ({answer.code}) in {answer.seconds:.1f} s, {answer.peak_mb:.0f} MB")
        print(*(f"  {ascii(word)[:1000]}" for word in answer.words if word), sep="\n")
        print(answer.log[-3000:])
    for finding in verdict.findings:
        print(f"FAULT {finding.fault.value}: {ascii(finding.detail)[1:-1]}")
    if keep:
        print(f"left in {campaign.folder}")
    return 1 if verdict.findings else 0


class _Ticker:
    """Tells of every fault, and how far the campaign is, now and then."""

    def __init__(self, started: float) -> None:
        self._started = started
        self._told = started
        self._faults = 0

    def __call__(self, tally: Tally) -> None:
        now = time.monotonic()
        faults = tally.faults
        for verdict in faults[self._faults :]:
            for finding in verdict.findings:
                detail = ascii(finding.detail)[1:-1]
                print(f"{verdict.name}: {finding.fault.value}: {detail}", file=sys.stderr)
        self._faults = len(faults)
        if now - self._told < 30:
            return
        self._told = now
        spent, done = (now - self._started) / 60, len(tally.verdicts)
        print(
            f"{spent:5.1f} min  {done} trials, {len(faults)} faults",
            file=sys.stderr,
            flush=True,
        )


if __name__ == "__main__":
    sys.exit(main())
