"""Whether what a trial left is a fault: one function, blind to how trials are made."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import PurePath

from .evidence import Answer, Evidence, Result

__all__ = ("HANG_SECONDS", "LONGEST_SENTENCE", "Fault", "Finding", "Normal", "judge")

HANG_SECONDS = 10.0
LONGEST_SENTENCE = 1000
_MEMORY = 2.0

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")
_STAGING = re.compile(r"\.part(ial)?\b")


class Fault(StrEnum):
    """The kinds of faults."""

    TRACEBACK = "traceback"
    HANG = "hang"
    DIED = "died"
    LOST = "result lost or half-written"
    HOLLOW = "done, with something missing"
    ABSURD = "done, with NaN or infinite values"
    MEMORY = "memory over twice the normal run"
    OUTSIDE = "file written outside"
    LITTER = "staged files left over"
    WORDS = "sentence with escape codes or over 1,000 characters"
    SILENT = "refused without a sentence"
    NOISE = "noise beside the sentence"
    WRONG = "wrong answer"


@dataclass(frozen=True)
class Finding:
    """A fault and what shows it."""

    fault: Fault
    detail: str


@dataclass(frozen=True)
class Normal:
    """What an undisturbed run takes."""

    seconds: float
    peak_mb: float


def judge(evidence: Evidence, normal: Normal) -> list[Finding]:
    """Every fault that `evidence` shows, beside a run that takes `normal`; none where all is
    well.
    """
    findings = [*_of_answer(evidence.answer, normal), *_of_files(evidence)]
    ended, expected = evidence.answer.ended, evidence.expected
    if ended in ("done", "refused") and expected is not None and ended != expected:
        said = " ".join(evidence.answer.words)[:200]
        findings.append(Finding(Fault.WRONG, f"{ended}, not {expected}: {said}"))
    findings += [Finding(Fault.WRONG, complaint) for complaint in evidence.complaints]
    return findings


def _of_answer(answer: Answer, normal: Normal) -> Iterator[Finding]:
    traceback = "Traceback (most recent call last)" in answer.log
    if traceback or answer.code == "internal":
        last = answer.log.strip().splitlines()[-1:] if traceback else answer.words[:1]
        yield Finding(Fault.TRACEBACK, "".join(last))
    elif answer.noise.strip():
        yield Finding(Fault.NOISE, answer.noise.strip().splitlines()[0])
    if answer.ended == "hung" or answer.seconds > HANG_SECONDS + normal.seconds:
        yield Finding(Fault.HANG, f"no end within {answer.seconds:.0f} s")
    if answer.ended == "died" and not traceback:
        yield Finding(Fault.DIED, answer.code)
    if answer.peak_mb > _MEMORY * normal.peak_mb:
        yield Finding(Fault.MEMORY, f"{answer.peak_mb:,.0f} MB beside {normal.peak_mb:,.0f} MB")
    if answer.ended == "refused" and not any(word.strip() for word in answer.words):
        yield Finding(Fault.SILENT, answer.code)
    for words in answer.words:
        if control := _CONTROL.search(words):
            yield Finding(Fault.WORDS, f"{control.group()!r} in {words[:120]!r}")
        if len(words) > LONGEST_SENTENCE:
            yield Finding(Fault.WORDS, f"{len(words):,} characters: {words[:120]!r}")


def _of_files(evidence: Evidence) -> Iterator[Finding]:
    if evidence.output is not None:
        yield from _of_output(evidence, evidence.output)
    for path in sorted(evidence.before.keys() | evidence.after.keys()):
        before, after = evidence.before.get(path), evidence.after.get(path)
        if before == after:
            continue
        output = None if evidence.output is None else PurePath(evidence.output)
        if output is not None and PurePath(path).is_relative_to(output):
            if before is None and _STAGING.search(path) and not evidence.abandoned:
                yield Finding(Fault.LITTER, path)
        elif not _may_change(evidence, PurePath(path), output, before, after):
            staged = before is None and _STAGING.search(path)
            fault = Fault.LITTER if staged else Fault.OUTSIDE
            yield Finding(fault, f"{path}: {before} became {after}")
            return


def _may_change(
    evidence: Evidence,
    path: PurePath,
    output: PurePath | None,
    before: str | None,
    after: str | None,
) -> bool:
    if output is not None and before is None and after == "folder" and output.is_relative_to(path):
        return True
    around = PurePath() if output is None else output.parent
    if not path.is_relative_to(around):
        return False
    beside = str(path.relative_to(around))
    if evidence.abandoned and before is None and beside.startswith("."):
        return True
    return any(re.match(pattern, beside) for pattern in evidence.beside)


def _of_output(evidence: Evidence, output: str) -> Iterator[Finding]:
    old, new = (_inside(tree, output) for tree in (evidence.before, evidence.after))
    if evidence.abandoned:
        new = {name: sort for name, sort in new.items() if not _STAGING.search(name)}
    ours = {"", "aged.json"}
    if evidence.earlier is not None:
        ours |= {*evidence.earlier.files, *evidence.earlier.broken}
    others = {name: sort for name, sort in old.items() if name not in ours}
    if lost := sorted(name for name, sort in others.items() if new.get(name) != sort):
        yield Finding(Fault.LOST, f"{lost[0]}, which was not ours, has become {new.get(lost[0])}")
    if not old and new and _is_empty(new) and evidence.answer.ended == "refused":
        yield Finding(Fault.LITTER, f"{output}, an empty folder")
    result = evidence.result
    if evidence.answer.ended == "done":
        yield from _of_result(evidence, result, new.keys() - others.keys())
    elif new != old and not (_is_empty(old) and _is_empty(new)):
        whole = result is not None and not any(
            _of_result(evidence, result, new.keys() - others.keys())
        )
        if not whole or (evidence.answer.ended == "refused" and not evidence.untold):
            names = old.keys() | new.keys()
            changed = sorted(name for name in names if old.get(name) != new.get(name))
            state = "a whole new result" if whole else f"{len(changed)} changes: {changed[0]} ..."
            yield Finding(Fault.LOST, f"{evidence.answer.ended}, but the output has {state}")


def _is_empty(inside: dict[str, str]) -> bool:
    """Nothing, or a folder without anything in it."""
    return not inside or inside == {"": "folder"}


def _of_result(evidence: Evidence, result: Result | None, present: set[str]) -> Iterator[Finding]:
    """What is wrong with a result that should be whole; `present` are the files that are not the
    user's.
    """
    if result is None:
        yield Finding(Fault.HOLLOW, "there is no result that can be read")
        return
    if result.broken:
        yield Finding(Fault.HOLLOW, f"{len(result.broken)} files: {result.broken[0]} ...")
    if result.absurd:
        yield Finding(Fault.ABSURD, f"{len(result.absurd)} files: {result.absurd[0]} ...")
    if left := sorted(present - result.files.keys() - {""}):
        yield Finding(Fault.LOST, f"{len(left)} files that no report lists: {left[0]} ...")
    if evidence.alone and result.textures not in evidence.alone:
        yield Finding(Fault.LOST, "the textures are none that an undisturbed run makes")


def _inside(tree: dict[str, str], output: str) -> dict[str, str]:
    """The part of `tree` that is the output: by name inside of it, itself under ""."""
    root = PurePath(output)
    inside = {"": tree[output]} if output in tree else {}
    for path, sort in tree.items():
        if PurePath(path).is_relative_to(root) and path != output:
            inside[str(PurePath(path).relative_to(root))] = sort
    return inside
