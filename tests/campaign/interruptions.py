"""What happens to a run from outside: signals, another run, inputs and staged files that change."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from .evidence import Answer, Evidence, Result, read_result, tree_of
from .trial import Trial

__all__ = ("attempt_change", "attempt_kill", "attempt_pair")

_SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_SETTLED = {signal.SIGINT: (130, -2)}
_FRAMES = 8


def attempt_kill(trial: Trial) -> list[Evidence]:
    """A command ended by a signal at any moment; then a run that has to succeed."""
    rng = trial.rng
    trial.textures()
    if rng.random() < 0.7:
        trial.put_earlier_result()
    sent = rng.choice(_SIGNALS)
    aim = _Aim(trial, sent, rng.choice(("any", "staged", "staged", "committed")))
    words = ["age"]
    for name, value in trial.request(frames=_FRAMES, temporal_model="affine").items():
        words += [f"--{name.replace('_', '-')}", str(value)]
    before = tree_of(trial.folder) | {"home": "folder"}
    killed = trial.command(*words, watch=aim)
    killed = replace(
        killed,
        abandoned=sent == signal.SIGKILL,
        complaints=(*aim.complaints(killed.answer),),
    )
    after = trial.age(trial.request(), before=before, expected="done")
    return [killed, after]


class _Aim:
    """Waits for the moment of a kill: any, while files are staged, or while they are committed."""

    def __init__(self, trial: Trial, sent: signal.Signals, moment: str) -> None:
        self._folder, self._output, self._signal = trial.folder, trial.output, sent
        self._moment = moment
        self._names = set(trial.folder.iterdir())
        self._before = self._stamp()
        usual = trial.lane.normal["command"].seconds
        least = 0.3 * usual
        self._delay = {
            "any": trial.rng.uniform(least, 1.1 * usual),
            "staged": trial.rng.choice((0.0, trial.rng.uniform(0, 0.2))),
            "committed": trial.rng.choice((0.0, trial.rng.uniform(0, 0.01))),
        }[moment]
        self._since: float | None = 0.0 if moment == "any" else None
        self._early = False

    def __call__(self, _pid: int, elapsed: float) -> signal.Signals | None:
        staged = self._is_staged()
        if self._since is None and (staged if self._moment == "staged" else self._is_committed()):
            self._since = elapsed
        if self._since is None or elapsed < self._since + self._delay:
            return None
        self._early = not staged and not self._is_committed()
        return self._signal

    def complaints(self, answer: Answer) -> list[str]:
        """What is wrong with how the command took the signal."""
        if self._early and answer.ended == "done" and answer.seconds:
            return [
                f"{self._signal.name} before anything was written, and the run went on to its end"
            ]
        wanted = _SETTLED.get(self._signal)
        if wanted and answer.ended != "done" and answer.code not in map(str, wanted):
            return [f"Ctrl-C ended with exit code {answer.code}, not 130"]
        return []

    def _is_staged(self) -> bool:
        new = set(self._folder.iterdir()) - self._names
        return any(path.name.startswith(".") for path in new)

    def _is_committed(self) -> bool:
        return self._stamp() != self._before

    def _stamp(self) -> tuple[int, int] | None:
        try:
            status = self._output.stat()
        except FileNotFoundError:
            return None
        return status.st_ino, status.st_mtime_ns


def attempt_pair(trial: Trial) -> list[Evidence]:
    """Two runs at once into one folder: it must hold one of the two, whole."""
    rng = trial.rng
    trial.textures()
    if rng.random() < 0.5:
        trial.put_earlier_result()
    requests = [
        trial.request(ntm=name, frames=frames, temporal_model="affine")
        for name, frames in (("rust", rng.choice((2, 6))), ("patina", rng.choice((2, 6, 12))))
    ]
    alone = tuple(_alone(trial, request).textures for request in requests)
    delays = [rng.choice((0.0, rng.uniform(0, 0.05))) for _ in requests]
    workers = (trial.lane.worker, trial.lane.other_worker)
    limit = trial.lane.limit("worker")
    answers: list[Answer] = [Answer("hung")] * 2

    def run(k: int) -> None:
        time.sleep(delays[k])
        answers[k] = workers[k].ask("age", requests[k], seconds=limit)

    def both() -> Answer:
        threads = [threading.Thread(target=run, args=(k,)) for k in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return min(answers, key=lambda answer: answer.ended != "done")

    for worker in workers:
        _ = worker.process  # it is warm before the race begins
    evidence = trial.observe(both, alone=alone)
    other = answers[1] if evidence.answer is answers[0] else answers[0]
    # Of two that are done either may be what is there; a refused one must not have made the other.
    second = replace(evidence, answer=other)
    return [evidence, second] if other.ended != "refused" else [evidence, _of_words(second)]


def _of_words(evidence: Evidence) -> Evidence:
    """Only the answer counts: what lies there is the other run's."""
    return replace(evidence, before=evidence.after, earlier=evidence.result)


def _alone(trial: Trial, request: dict[str, Any]) -> Result:
    """What `request` gives when nothing disturbs it."""
    output = trial.lane.folder / "alone"
    shutil.rmtree(output, ignore_errors=True)
    answer = trial.lane.worker.ask(
        "age", request | {"output": str(output)}, seconds=trial.lane.limit("worker")
    )
    result = read_result(output)
    assert result is not None, answer
    return result


def attempt_change(trial: Trial) -> list[Evidence]:
    """The input, the staged files or the output changed by somebody during a run."""
    rng = trial.rng
    trial.textures()
    if rng.random() < 0.4:
        trial.put_earlier_result()
    request = trial.request(frames=_FRAMES)
    first = _alone(trial, request)
    other = trial.textures("other")
    content = (other / "M_Roughness.png").read_bytes()
    (other / "M_Color.png").write_bytes(content)
    second = _alone(trial, request | {"input": str(other)})
    staged = rng.random() < 0.4
    change = rng.choice(_OF_STAGED if staged else _OF_INPUT)
    delay = rng.uniform(0, 0.02) if staged else rng.uniform(0, 0.1)
    before = tree_of(trial.folder)
    stop = threading.Event()
    worker, limit = trial.lane.worker, trial.lane.limit("worker")
    _ = worker.process

    def meddle() -> None:
        until = time.monotonic() + 5
        while staged and not _staging(trial) and time.monotonic() < until and not stop.is_set():
            time.sleep(0.0005)
        stop.wait(delay)
        change(trial, content)

    def run() -> Answer:
        meddling = threading.Thread(target=meddle)
        meddling.start()
        answer = worker.ask("age", request, seconds=limit)
        stop.set()
        meddling.join()
        return answer

    evidence = trial.observe(run, before=before, alone=(first.textures, second.textures))
    if not staged:
        # What the trial itself did to the input is no fault of the program.
        after = {k: v for k, v in evidence.after.items() if not k.startswith("in")}
        kept = {k: v for k, v in evidence.before.items() if k.startswith("in")}
        evidence = replace(evidence, after={**after, **kept})
    complaint = _hash_complaint(evidence, first, second, content, trial)
    return [replace(evidence, complaints=complaint)]


def _hash_complaint(
    evidence: Evidence, first: Result, second: Result, content: bytes, trial: Trial
) -> tuple[str, ...]:
    """The report has to name, by its hash, the color that the textures were made of."""
    if evidence.answer.ended != "done" or evidence.result is None:
        return ()
    named = evidence.answer.result.get("hashes", {}).get("input", {}).get("M_Color.png")
    honest = (trial.samples.textures / "M_Color.png").read_bytes()
    made_of = {
        hashlib.sha256(c).hexdigest(): r.textures for c, r in ((honest, first), (content, second))
    }
    if made_of.get(named) != evidence.result.textures and first.textures != second.textures:
        return ("aged.json has the hash of an input that the textures were not made of",)
    return ()


def _staging(trial: Trial) -> list[Path]:
    return [path for path in trial.folder.iterdir() if path.name.startswith(".")]


def _replace(trial: Trial, content: bytes) -> None:
    path = trial.folder / "new.png"
    path.write_bytes(content)
    path.replace(trial.folder / "in" / "M_Color.png")


def _rewrite(trial: Trial, content: bytes) -> None:
    (trial.folder / "in" / "M_Color.png").write_bytes(content)


def _delete(trial: Trial, content: bytes) -> None:
    (trial.folder / "in" / "M_Color.png").unlink()


def _delete_all(trial: Trial, content: bytes) -> None:
    shutil.rmtree(trial.folder / "in")


def _each_staged(trial: Trial, act: Callable[[Path], object]) -> None:
    files = [Path(*each) for folder in _staging(trial) for each in _files_in(folder)]
    for path in trial.rng.sample(sorted(files), min(len(files), 3)):
        try:
            act(path)
        except FileNotFoundError:
            continue  # it has been moved in the meantime


def _files_in(folder: Path) -> Iterator[tuple[str, str]]:
    for parent, _, names in os.walk(folder):
        yield from ((parent, name) for name in names)


def _unstage(trial: Trial, content: bytes) -> None:
    _each_staged(trial, Path.unlink)


def _truncate(trial: Trial, content: bytes) -> None:
    _each_staged(trial, lambda path: os.truncate(path, 100))


def _unstage_all(trial: Trial, content: bytes) -> None:
    for folder in _staging(trial):
        shutil.rmtree(folder, ignore_errors=True)


_OF_INPUT = (_replace, _replace, _rewrite, _delete, _delete_all)
_OF_STAGED = (_unstage, _truncate, _unstage_all)
