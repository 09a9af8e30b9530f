"""What came of the trials: counts per kind and the faults, as a table for people and as JSON."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from .judge import Finding

__all__ = ("Tally", "Verdict")

_COLUMNS = ("Kind", "Trials", "Passed", "Refused with a sentence", "Faults")
_SHOWN = 160
_VARYING = r"'[^']*'|\"[^\"]*\"|/\S+|\S*[._-]\S+|[0-9a-f]{8}|\d[\d,.]*"


@dataclass(frozen=True)
class Verdict:
    """How one trial ended: a fault where there is any finding, refused or passed where not."""

    kind: str
    number: int
    refused: bool
    findings: tuple[Finding, ...] = ()

    @property
    def name(self) -> str:
        """What `--only` takes."""
        return f"{self.kind}:{self.number}"


class Tally:
    """All verdicts of a campaign."""

    def __init__(self) -> None:
        self.verdicts: list[Verdict] = []

    def add(self, verdict: Verdict) -> None:
        self.verdicts.append(verdict)

    @property
    def faults(self) -> list[Verdict]:
        return [verdict for verdict in self.verdicts if verdict.findings]

    def rows(self) -> Iterator[tuple[str, int, int, int, int]]:
        """Kind, trials, passed, refused, faults; the sum of all comes last."""
        kinds: dict[str, Counter[str]] = defaultdict(Counter)
        for verdict in self.verdicts:
            ended = "fault" if verdict.findings else "refused" if verdict.refused else "passed"
            kinds[verdict.kind][ended] += 1
            kinds[verdict.kind]["trials"] += 1
        for kind, count in sorted(kinds.items()):
            yield kind, count["trials"], count["passed"], count["refused"], count["fault"]
        total: Counter[str] = sum(kinds.values(), Counter())
        yield "all", total["trials"], total["passed"], total["refused"], total["fault"]

    def distinct(self) -> Iterator[tuple[int, Verdict, Finding]]:
        """Of each sort of fault how many trials showed it, the first one, and what it showed."""
        alike: dict[tuple[str, str, str], list[tuple[Verdict, Finding]]] = defaultdict(list)
        for verdict in self.faults:
            for finding in verdict.findings:
                sort = (verdict.kind, finding.fault.value, _pattern(finding.detail))
                alike[sort].append((verdict, finding))
        for (_, _, _), found in sorted(alike.items()):
            yield len({verdict.number for verdict, _ in found}), *found[0]

    def markdown(self, title: str) -> str:
        """The table, and below it each sort of fault with a trial that shows it."""
        lines = [title, "", _row(_COLUMNS), _row(["---", *["--:"] * (len(_COLUMNS) - 1)])]
        lines += [
            _row([f"{cell:,}" if isinstance(cell, int) else cell for cell in row])
            for row in self.rows()
        ]
        distinct = list(self.distinct())
        if distinct:
            lines += ["", "Each sort of fault, with the first trial that showed it:", ""]
        for count, verdict, finding in distinct:
            shown = ascii(finding.detail)[1:-1][:_SHOWN].replace("`", "'")
            lines.append(f"- `--only {verdict.name}` ({count}) {finding.fault.value}: `{shown}`")
        return "\n".join([*lines, ""])

    def json(self) -> dict[str, Any]:
        return {
            "kinds": {
                kind: dict(zip(("trials", "passed", "refused", "faults"), row, strict=True))
                for kind, *row in self.rows()
            },
            "faults": [asdict(verdict) for verdict in self.faults],
        }


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _pattern(detail: str) -> str:
    """The beginning of `detail` without what differs from trial to trial: names and numbers."""
    return re.sub(_VARYING, "#", detail)[:50]
