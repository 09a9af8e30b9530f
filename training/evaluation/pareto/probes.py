"""What is measured once, not for each setting: memory and growth, uniforms, the warm worker."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from model_runtime.age import AgeRequest
from model_runtime.images import write_exr

from ..bench.aging import age_silently, megabytes

__all__ = ("large_run", "uniform_run", "warm_worker")

_ROOT = Path(__file__).parents[3]
_CLICKS = 5

_CHILD = """
import json, sys, time
from pathlib import Path
from model_runtime.age import AgeRequest
from training.evaluation.bench.aging import age_silently, megabytes
material, ntm, output, size, frames, binding = sys.argv[1:]
request = AgeRequest(
    Path(material), ntm, Path(output), size=int(size), frames=int(frames), binding=binding
)
wall, core = time.perf_counter(), time.process_time()
report = age_silently(request)
print(json.dumps({"wall": time.perf_counter() - wall, "core": time.process_time() - core,
    "peak_rss_mb": report["peak_rss_mb"], "megabytes": megabytes(Path(output))}))
"""


def large_run(
    material: Path, ntm: str, *, size: int, frames: int, beside: Path, binding: str = "frames"
) -> dict[str, float]:
    """A balanced run in a process of its own: `wall` and `core` seconds, `peak_rss_mb` and
    `megabytes` of what it wrote.

    The folder `beside` holds its maps for a while.
    """
    with tempfile.TemporaryDirectory(dir=beside) as output:
        words = [str(material), ntm, f"{output}/maps", str(size), str(frames), binding]
        said = subprocess.check_output([sys.executable, "-c", _CHILD, *words], cwd=_ROOT)
    return json.loads(said)


def uniform_run(ntm: str, *, frames: int, size: int, beside: Path) -> Mapping[str, Any]:
    """A uniform material without onset, and the same as a texture `size` wide: `core` seconds and
    `megabytes` of each.
    """
    found: dict[str, Any] = {}
    for name, side in (("uniform", 1), ("texture", size)):
        with tempfile.TemporaryDirectory(dir=beside) as place:
            source = Path(place) / "in"
            source.mkdir()
            for map_name, channels in (("kd", (3,)), ("ks", (3,)), ("alpha", ())):
                pixels = np.full((side, side, *channels), 0.2, np.float32)
                write_exr(source / f"{map_name}.exr", pixels)
            output = Path(place) / "out"
            clock = time.process_time()
            age_silently(AgeRequest(source, ntm, output, frames=frames, onset="none"))
            found[name] = {
                "core": round(time.process_time() - clock, 3),
                "megabytes": round(megabytes(output), 3),
            }
    return found


def warm_worker(material: Path, ntm: str, *, size: int, beside: Path) -> dict[str, float]:
    """Seconds from a click to the first word of progress, as the add-on asks: `cold`, from the
    start of the process on, and `warm`, the worst of a few clicks after.
    """
    with tempfile.TemporaryDirectory(dir=beside) as output:
        start = time.perf_counter()
        with subprocess.Popen(
            [sys.executable, "-m", "model_runtime", "serve"],
            cwd=_ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        ) as worker:
            assert worker.stdin is not None and worker.stdout is not None
            waited = []
            for click in range(1 + _CLICKS):
                if click:
                    start = time.perf_counter()
                args = {"input": str(material), "ntm": ntm, "output": f"{output}/maps"}
                args |= {"size": size, "frames": 2}
                worker.stdin.write(json.dumps({"id": click, "verb": "age", "args": args}) + "\n")
                worker.stdin.flush()
                first = None
                for line in worker.stdout:
                    reply = json.loads(line)
                    if reply["type"] == "progress" and first is None:
                        first = time.perf_counter() - start
                    if reply["type"] in ("done", "error"):
                        break
                assert first is not None and reply["type"] == "done", reply
                waited.append(first)
            worker.stdin.close()
    return {"cold": round(waited[0], 3), "warm": round(max(waited[1:]), 4)}
