"""What each bundled model costs where it is shown live.

    python -m tests.benchmarks.live_costs [--size 1024] [--materials N]

A warm worker ages texture sets with every model at draft and balanced, without a surface.  Prints
for each model how many can be live, and their means: seconds by the clock and of a core, MB on
disk, coefficients.  It needs the data (`TVBRDF_DATA`).
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

from model_runtime.age import AgeRequest, age
from model_runtime.contract import LIVE
from model_runtime.model_files.weights import list_models

QUALITIES = ("draft", "balanced")


class Silence:
    """Who hears of a run and does nothing about it."""

    def progress(self, stage: str, fraction: float) -> None: ...

    def warning(self, message: str) -> None: ...

    def cancelled(self) -> bool:
        return False


def row(name: str, quality: str, sources: list[Path], size: int, place: Path) -> str:
    """A line of the table: the means over the texture sets, after one run to warm up."""
    runs: list[tuple[float, ...]] = []
    for number, source in enumerate([sources[0], *sources]):
        folder = place / str(number)
        request = AgeRequest(
            input=source, output=folder, ntm=name, size=size, quality=quality, binding=LIVE
        )
        clock, core = time.perf_counter(), time.process_time()
        report = age(request, Silence())
        seconds = time.perf_counter() - clock, time.process_time() - core
        if number and report["binding"] == LIVE:
            megabytes = sum(each.stat().st_size for each in folder.iterdir()) / 1e6
            runs.append((*seconds, megabytes, report["coefficients"]))
    clock, core, megabytes, count = map(statistics.mean, zip(*runs, strict=True))
    return (
        f"| {name} | {quality} | {len(runs)} of {len(sources)} | {clock:.2f} | {core:.2f} | "
        f"{megabytes:.1f} | {count:.1f} |"
    )


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--size", type=int, default=1024)
    parser.add_argument("--materials", type=int, default=12)
    options = parser.parse_args(argv)
    data = os.environ.get("TVBRDF_DATA")
    if not data:
        print("Set TVBRDF_DATA to the folder of the data.", file=sys.stderr)
        return 2
    sources = sorted(each for each in Path(data, "pbr").iterdir() if each.is_dir())
    print("| model | quality | live | s by the clock | core s | MB | coefficients |")
    print("|---|---|---|---|---|---|---|")
    for card in list_models():
        for quality in QUALITIES:
            with tempfile.TemporaryDirectory() as place:
                of = sources[: options.materials]
                print(row(card.name, quality, of, options.size, Path(place)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
