"""Lines that the worker may be sent: odd, broken, huge, many at once, and then none any more."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from typing import Any

from .damage import ODD_TEXTS, ODD_VALUES, damaged, damaged_json
from .evidence import Answer, Evidence
from .programs import Gone
from .trial import Trial

__all__ = ("attempt_protocol",)

_LAST = "the last one"
_SENTENCES = ("message", "hint")


def attempt_protocol(trial: Trial) -> list[Evidence]:
    """Every line is answered once, the worker goes on, and it ends when its stdin closes."""
    trial.textures()
    lines = [_line(trial) for _ in range(trial.rng.choice((1, 2, 5, 20)))]
    closing = trial.rng.random() < 0.15
    answers: list[dict[str, Any]] = []
    evidence = trial.observe(lambda: _talk(trial, lines, answers, closing))
    wrong = ()
    if evidence.answer.ended == "done" and len(answers) != len(lines):
        wrong = (f"{len(lines)} lines have {len(answers)} answers",)
    # Where no run came to its end there is no result, and nothing else may be there.
    aged = any("files" in (reply.get("result") or ()) for reply in answers)
    output = evidence.output if aged else None
    return [replace(evidence, complaints=wrong, output=output)]


def _talk(trial: Trial, lines: list[bytes], answers: list[dict[str, Any]], closing: bool) -> Answer:
    worker, words = trial.lane.worker, []
    _ = worker.process
    worker.forget_peak()
    started = time.monotonic()
    until = started + trial.lane.limit("worker")
    last = json.dumps({"id": _LAST, "verb": "info"}).encode()
    try:
        for line in lines:
            worker.send(line)
            if trial.rng.random() < 0.2:
                time.sleep(trial.rng.uniform(0, 0.05))
        worker.send(last)
        ended = False
        while not (ended and len(answers) >= len(lines)):
            reply = worker.receive(until if not ended else min(until, time.monotonic() + 3))
            if reply is None:
                break
            words += [str(reply[key]) for key in _SENTENCES if key in reply]
            if reply.get("id") == _LAST:
                ended = True
            elif reply["type"] in ("done", "error"):
                answers.append(reply)
    except Gone as gone:
        return Answer("died", str(gone), log=worker.log(), seconds=time.monotonic() - started)
    seconds, peak = time.monotonic() - started, worker.peak_mb()
    if not ended:
        worker.end()
        return Answer("hung", log=worker.log(), seconds=seconds)
    code = worker.end(closing=True, seconds=trial.lane.limit("worker")) if closing else ""
    log = worker.log()
    if code not in ("", "exit code 0"):
        return Answer("hung" if code == "still running" else "died", code, log=log, seconds=99.0)
    return Answer("done", code, tuple(words), log=log, noise=log, seconds=seconds, peak_mb=peak)


def _line(trial: Trial) -> bytes:
    """One line without line ends: a request with something odd in it, or anything."""
    rng = trial.rng
    ids = (1, "a", None, 1.5, [], {}, 10**30, True, "\ud800", "x" * 10_000, float("nan"))
    args = trial.request(frames=rng.choice((1, 2, 40)))
    request: dict[str, Any] = {"id": rng.choice(ids), "verb": "age", "args": args}
    # A path that a flipped byte makes lies anywhere; a run that reads nothing writes nothing.
    harmless = request | {"args": args | {"input": "absent"}}
    match rng.randrange(10):
        case 0:
            return _one_line(damaged(json.dumps(harmless).encode(), rng))
        case 1:
            return _one_line(rng.randbytes(rng.choice((1, 100, 100_000))))
        case 2:
            return rng.choice(
                (b"[" * 100_000, b'{"id":' * 50_000, b'"' + b"x" * 10_000_000, b"\xff")
            )
        case 3:
            return _one_line(damaged_json(harmless, rng))
        case 4:
            request["verb"] = rng.choice((*ODD_VALUES, *ODD_TEXTS))
        case 5:
            request["args"] = rng.choice((*ODD_VALUES, *ODD_TEXTS))
        case 6:
            request |= {"verb": "info", "args": {"ntm": rng.choice((*ODD_VALUES, "rust"))}}
        case 7:
            request |= {"verb": "cancel", "args": {"id": rng.choice((*ids, *ODD_VALUES))}}
        case 8:
            request |= {"verb": "cancel", "args": {}}
    return json.dumps(request).encode()


def _one_line(content: bytes) -> bytes:
    """`content` without line ends, and not blank, which needs no answer."""
    line = content.replace(b"\n", b"0").replace(b"\r", b"0")
    return line if line.decode(errors="replace").strip() else b"0"
