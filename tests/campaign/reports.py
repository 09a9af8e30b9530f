"""Reports and rates as the add-on finds them: damaged, absurd, or no files at all."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any

from .damage import damaged_json
from .evidence import Answer, Evidence
from .programs import Gone
from .trial import Trial

__all__ = ("ask_reader", "attempt_report")

_RATES = {
    "overhead": 0.6,
    "write": {"draft": 6e-8, "balanced": 1.7e-7},
    "stored": {"draft": 12.0, "balanced": 6.0},
    "model": {"balanced parameters": 0.25, "exact latents": 0.011},
}


def attempt_report(trial: Trial) -> list[Evidence]:
    """A result's `aged.json`, or the file of rates, as nobody wrote it."""
    rng = trial.rng
    trial.put_earlier_result()
    path = trial.output / "aged.json"
    honest: Any = json.loads(path.read_text())
    what = "report"
    if rng.random() < 0.2:
        path, honest, what = trial.folder / "rates.json", _RATES, "rates"
    else:
        path.unlink()
    match rng.randrange(10):
        case 0:
            os.mkfifo(path)
        case 1:
            path.symlink_to(rng.choice(("/dev/zero", path, "absent", trial.folder)))
        case 2:
            path.mkdir()
        case 3:
            seconds = {stage: rng.choice((1e999, 1e308, -1.0, 1e-9, True, "3")) for stage in "rw"}
            path.write_text(json.dumps(honest | {"seconds": seconds}))
        case 4:
            path.touch()
            os.truncate(path, rng.choice((0, 1 << 40)))
        case _:
            path.write_bytes(damaged_json(honest, rng))
    return [ask_reader(trial, what, path if what == "rates" else trial.output)[0]]


def ask_reader(trial: Trial, what: str, path: Path) -> tuple[Evidence, list[str]]:
    """What the add-on's plain Python makes of `path`, and what it would say."""
    reader, said = trial.lane.reader, []

    def ask() -> Answer:
        started = time.monotonic()
        try:
            reader.forget_peak()
            reader.send(json.dumps({what: str(path)}).encode())
            reply = reader.receive(started + trial.lane.limit("reader"))
        except Gone as gone:
            return Answer("died", str(gone), log=reader.log())
        seconds = time.monotonic() - started
        if reply is None:
            reader.end()
            return Answer("hung", seconds=seconds)
        said.extend(reply["said"])
        log, peak = reader.log(), reader.peak_mb()
        return Answer("done", words=tuple(said), log=log, noise=log, seconds=seconds, peak_mb=peak)

    return trial.observe(ask, writes=False), said
