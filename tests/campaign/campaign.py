"""Runs trials, two at a time, until there are enough or the time is over."""

from __future__ import annotations

import itertools
import os
import random
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from .evidence import Evidence
from .judge import Normal, judge
from .kinds import KINDS, calibrate
from .samples import Samples
from .tally import Tally, Verdict
from .trial import Kind, Lane, Trial

__all__ = ("Campaign",)


class Campaign:
    """A folder for all trials, and lanes in which they run side by side.

    `keep`: leave the trials' folders there, to look at.
    """

    def __init__(self, kinds: Sequence[str], *, lanes: int = 2, keep: bool = False) -> None:
        self._kinds = [KINDS[name] for name in kinds]
        self._keep = keep
        self.folder = Path(tempfile.mkdtemp(prefix="tvbrdf-campaign-"))
        made = self.folder / "made"
        made.mkdir()
        self._lanes = [self._lane(k, made) for k in range(lanes)]
        # Every kind has to have what is normal, and an earlier result to lose.
        ways = dict.fromkeys(["worker", *(kind.way for kind in self._kinds)])
        try:
            normal = calibrate(self._lanes[0], ways)
        except BaseException:
            self.close()
            raise
        for lane in self._lanes:
            lane.normal = normal

    def _lane(self, k: int, made: Path) -> Lane:
        folder = self.folder / f"lane {k}"
        folder.mkdir()
        return Lane(folder, Samples(folder / "samples", made))

    @property
    def normal(self) -> Mapping[str, Normal]:
        return self._lanes[0].normal

    def run(
        self, *, seed: int, trials: int | None, until: float, heard: Callable[[Tally], None]
    ) -> Tally:
        """Trials drawn by `seed`, `trials` of them at most, until the clock shows `until`."""
        tally, lock = Tally(), threading.Lock()
        drawn = self._draw(seed, trials)

        def run(lane: Lane) -> None:
            while time.monotonic() < until:
                with lock:
                    kind, number = next(drawn, (None, 0))
                if kind is None:
                    return
                verdict, _ = self._attempt(lane, kind, number)
                with lock:
                    tally.add(verdict)
                    heard(tally)

        with ThreadPoolExecutor(len(self._lanes)) as pool:
            list(pool.map(run, self._lanes))
        return tally

    def only(self, name: str, number: int) -> tuple[Verdict, list[Evidence]]:
        """One trial alone, with all that it left."""
        return self._attempt(self._lanes[0], KINDS[name], number)

    def close(self) -> None:
        for lane in self._lanes:
            lane.close()
        if not self._keep:
            _remove(self.folder)

    def _draw(self, seed: int, trials: int | None) -> Iterator[tuple[Kind, int]]:
        """Kinds by their share, every one of them early; a trial's number tells the seed."""
        rng = random.Random(seed)
        shares = [kind.share for kind in self._kinds]
        for k in itertools.count() if trials is None else range(trials):
            if k < len(self._kinds):
                kind = self._kinds[k]
            else:
                (kind,) = rng.choices(self._kinds, shares)
            yield kind, seed * 1_000_000 + k

    def _attempt(self, lane: Lane, kind: Kind, number: int) -> tuple[Verdict, list[Evidence]]:
        folder = lane.folder / f"{kind.name} {number}"
        folder.mkdir()
        try:
            evidence = kind.attempt(Trial(number, kind, lane, folder))
        except Exception as error:
            error.add_note(f"This is a mistake of the campaign itself, in {kind.name}:{number}.")
            raise
        findings = [finding for each in evidence for finding in judge(each, lane.normal[kind.way])]
        refused = any(each.answer.ended == "refused" for each in evidence)
        if not self._keep:
            _remove(folder)
        return Verdict(kind.name, number, refused, tuple(findings)), evidence


def _remove(folder: Path) -> None:
    """Remove `folder`, with what may not be entered."""
    for parent, _, _ in os.walk(folder):
        Path(parent).chmod(0o700)
    shutil.rmtree(folder)
