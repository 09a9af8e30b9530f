"""What ages with PyTorch and what ages over numpy, held against each other.

    python -m tests.benchmarks.backends [--size 256] [--materials N] [--models A,B]
        [--binding live]

Two workers, one for each, age the same texture sets with every bundled model at draft and balanced,
one after the other and in turns.  Prints, for each model, the least PSNR of the maps that both show
(peak 1; of reflectances the square roots; at four times), the seconds of a core that all runs took,
which what else the machine does hardly changes, how many times PyTorch's numpy's are, and that of
the runs' seconds as a median.  At the end how long a worker takes from its start to the first sign
of progress.  It needs the data (`TVBRDF_DATA`) and Linux.  Exit code 0 only where all maps are
within 60 dB.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from model_runtime.contract import BACKEND, BINDINGS, LIVE, NUMPY, TORCH
from model_runtime.images import read_image
from model_runtime.live.files import read_live
from model_runtime.model_files.weights import list_models
from tests.live_states import start_of

ROOT = Path(__file__).resolve().parents[2]
QUALITIES = ("draft", "balanced")
DB = 60.0
_MOST_DB = 120.0
_TIMES = (0.1, 0.3, 0.6, 1.0)
_STARTS = 3


class Worker:
    """A worker of one backend."""

    def __init__(self, backend: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "model_runtime", "serve"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=ROOT,
            env={**os.environ, BACKEND: backend},
            text=True,
        )

    @property
    def core_seconds(self) -> float:
        """What it has computed so far."""
        stat = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")

    def said(self, job: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """What it says of a job, to the end."""
        assert self._process.stdin is not None and self._process.stdout is not None
        request = {"id": 1, "verb": "age", "args": job}
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        for line in self._process.stdout:
            message = json.loads(line)
            if message.get("id") == 1:
                yield message
                if message["type"] in ("done", "error"):
                    return

    def age(self, job: dict[str, Any]) -> dict[str, Any]:
        """`aged.json`."""
        *_, last = self.said(job)
        if last["type"] == "error":
            raise SystemExit(f"{job}: {last['message']}")
        return last["result"]

    def end(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


@dataclass
class Found:
    """Of one model: least dB, the seconds of a core, and the ratio of the runs' seconds."""

    db: float = _MOST_DB
    torch: float = 0.0
    numpy: float = 0.0
    ratios: list[float] = field(default_factory=list)

    def row(self, name: str) -> str:
        return (
            f"| {name} | {self.db:.0f} | {self.torch:.1f} | {self.numpy:.1f} | "
            f"{self.numpy / self.torch:.2f} | {statistics.median(self.ratios):.2f} |"
        )


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(-10 * np.log10(max(float(np.square(one - other).mean()), 10 ** (-_MOST_DB / 10))))


def near(source: Path, size: int, one: Path, other: Path) -> float:
    """The least PSNR of what two results show."""
    first, second = (json.loads((each / "aged.json").read_text()) for each in (one, other))
    if first["binding"] != second["binding"]:
        return 0.0
    found = [_MOST_DB]
    if first["binding"] == LIVE:
        start = start_of(source, size)
        shown = read_live(one), read_live(other)
        for at in _TIMES:
            a, b = (each.at(start, at).clip(0) for each in shown)
            found += [psnr(np.sqrt(a[..., :6]), np.sqrt(b[..., :6])), psnr(a[..., 6:], b[..., 6:])]
        return min(found)
    for name, files in first["files"].items():
        for file in files[:: max(1, len(files) // len(_TIMES))]:
            a, b = (read_image(each / file, color=True) for each in (one, other))
            seen = np.abs if name == "height" else np.sqrt
            found.append(psnr(seen(a), seen(b)))
    return min(found)


def cold(backend: str, job: dict[str, Any]) -> float:
    """Seconds from the start of a worker to the first sign of progress."""
    start = time.perf_counter()
    worker = Worker(backend)
    for message in worker.said(job):
        if message["type"] == "progress":
            seconds = time.perf_counter() - start
            break
    else:
        raise SystemExit("It never got under way.")
    worker.end()
    return seconds


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--materials", type=int)
    parser.add_argument("--models", default=",".join(card.name for card in list_models()))
    parser.add_argument("--binding", choices=(*BINDINGS,), default=LIVE)
    options = parser.parse_args()
    data = Path(os.environ.get("TVBRDF_DATA") or ROOT.parent / "shared" / "data").resolve()
    materials = sorted(path for path in (data / "pbr").iterdir() if path.is_dir())
    found: dict[str, Found] = {}
    workers = {backend: Worker(backend) for backend in (TORCH, NUMPY)}
    with tempfile.TemporaryDirectory() as temporary:
        places = {backend: Path(temporary) / backend for backend in workers}
        first = {"input": str(materials[0]), "ntm": "rust", "size": 64}
        for backend, worker in workers.items():
            worker.age({**first, "output": str(places[backend])})  # what is imported is not counted
        for name in options.models.split(","):
            mine = found[name] = Found()
            for source in materials[: options.materials]:
                for quality in QUALITIES:
                    job = {"input": str(source), "ntm": name, "quality": quality}
                    job |= {"size": options.size, "binding": options.binding}
                    took: dict[str, float] = {}
                    for backend, worker in workers.items():
                        before = worker.core_seconds
                        said = worker.age({**job, "output": str(places[backend])})
                        took[backend] = sum(said["seconds"].values())
                        computed = worker.core_seconds - before
                        setattr(mine, backend, getattr(mine, backend) + computed)
                    mine.ratios.append(took[NUMPY] / took[TORCH])
                    db = near(source, options.size, *places.values())
                    if db < DB:
                        print(f"{source.name} {name} {quality}: {db:.1f} dB", flush=True)
                    mine.db = min(mine.db, db)
            print(mine.row(name), flush=True)
        for worker in workers.values():
            worker.end()
        job = {**first, "output": f"{temporary}/cold"}
        starts = {each: min(cold(each, job) for _ in range(_STARTS)) for each in (TORCH, NUMPY)}
    everything = Found(
        min(each.db for each in found.values()),
        sum(each.torch for each in found.values()),
        sum(each.numpy for each in found.values()),
        [ratio for each in found.values() for ratio in each.ratios],
    )
    print(everything.row("all"))
    print(", ".join(f"{name}: first progress after {s:.1f} s" for name, s in starts.items()))
    return 0 if everything.db >= DB else 1


if __name__ == "__main__":
    sys.exit(main())
