"""Measures what the second run of the very same costs: what was kept is taken, not aged.

    python -m tests.benchmarks.kept [--input FOLDER] [--ntm rust] [--binding live] [--size 1024]

Prints seconds and seconds of a core of a first run that keeps its result, of a second that takes
it, of telling whether two are the same, and what is kept.  Both run in this process, which has
loaded all that it needs, as a worker has.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from model_runtime.contract import CACHE_SECONDS, LIVE, AgeRequest
from model_runtime.keeping import _Same, age_or_take
from model_runtime.output.kept import Kept
from tests.aging import Listener, contents

DATA = Path(os.environ.get("TVBRDF_DATA", "../shared/data"))


def timed(what: str, work: Callable[[], object]) -> object:
    wall, busy = time.perf_counter(), time.process_time()
    found = work()
    wall, busy = time.perf_counter() - wall, time.process_time() - busy
    print(f"| {what} | {wall:.3f} | {busy:.3f} |", flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--input", type=Path, default=DATA / "pbr" / "PaintedMetal007")
    parser.add_argument("--ntm", default="rust")
    parser.add_argument("--binding", default=LIVE)
    parser.add_argument("--size", type=int, default=1024)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        kept = Kept(Path(place) / "kept", 2e9)

        def run(output: str) -> dict[str, object]:
            wanted = AgeRequest(output=Path(place) / output, **vars(arguments))
            return age_or_take(wanted, Listener(), kept)

        print("| | seconds | of a core |\n|---|---|---|")
        timed("first", lambda: run("first"))
        assert CACHE_SECONDS in timed("second", lambda: run("second"))  # type: ignore[operator]
        wanted = AgeRequest(output=Path(place), **vars(arguments))
        timed("to tell", lambda: _Same.of(wanted))
        print(f"{kept.size() / 1e6:.1f} MB are kept.")
        first, second = (contents(Path(place) / name) for name in ("first", "second"))
        assert first.keys() == second.keys()
        assert all(first[name] == second[name] for name in first if name != "aged.json")


main()
