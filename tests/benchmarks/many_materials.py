"""Measures what many materials in one scene cost: time, memory and files, in one command.

    python -m tests.benchmarks.many_materials [--counts 10 100] [--size 16] [--steps 9] [--grows]
        [--stub]

Each material has a texture, a mesh and an object of its own; all are aged by one `age_material
--all --save-as`, each count in a process of its own.  With `--grows` they start by their surface,
else everywhere at once.  With `--stub` the worker computes nothing: the rest is the add-on's.
"Of Blender" are seconds of a processor that its process used for each, whatever else runs on the
machine.  "Last / first" is what the last tenth of the materials took over what the first tenth did:
1 where nothing grows with what is in the file already.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np

import tests.conftest  # noqa: F401 - which finds the working tree as `tvbrdf`
import tvbrdf
from tests.blender.material_cases import image, link, new_material, plane
from tvbrdf.tvbrdf_addon import session
from tvbrdf.tvbrdf_addon.headless.command import main as age_material

STUB = Path(__file__).resolve().parents[1] / "stub_worker.py"
COLUMNS = (
    *("materials", "seconds", "s each", "last / first", "of Blender", "last / first of Blender"),
    *("s to choose", "s to save", "s to open"),
    *("Blender MB", "worker MB", "workers", "files", "MB", ".blend MB"),
)


def build(count: int, pixels: int) -> None:
    """A saved file with so many textured planes side by side."""
    rng = np.random.default_rng(0)
    columns = int(np.ceil(np.sqrt(count)))
    for number in range(count):
        material = new_material(f"Paint {number:05d}")
        node = material.node_tree.nodes.new("ShaderNodeTexImage")
        node.image = image(material.name, rng.random((pixels, pixels, 3), np.float32))
        node.image.pack()
        link(material, node.outputs["Color"], "Base Color")
        plane(material).location = (*(3.0 * at for at in divmod(number, columns)), 0.0)
    bpy.ops.wm.save_as_mainfile(filepath=str(Path("scene.blend").absolute()))


class Watch:
    """Notes when each material was aged, by which worker, and what that said of its memory."""

    def __init__(self) -> None:
        self.begun: list[float] = []
        self.seconds: list[float] = []
        self.busy: list[float] = []
        self.workers: set[int | None] = set()
        self.worker_mb = 0.0
        self._age, session.age_and_wait = session.age_and_wait, self.age_and_wait

    def age_and_wait(self, *arguments, **settings):
        self.begun.append(time.perf_counter())
        busy = time.process_time()
        run = self._age(*arguments, **settings)
        self.seconds.append(time.perf_counter() - self.begun[-1])
        self.busy.append(time.process_time() - busy)
        self.workers.add(session._worker.pid)
        self.worker_mb = max(self.worker_mb, run.aged["peak_rss_mb"])
        return run


def measured(count: int, size: int, words: list[str]) -> dict[str, float]:
    """The figures of one count, in this process and the folder that it is in."""
    tvbrdf.register()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    build(count, size)
    watch, started = Watch(), time.perf_counter()
    code = age_material(["--all", *words, "--output", "aged", "--save-as", "aged.blend", "--quiet"])
    ended = time.perf_counter()
    assert code == 0, code
    assert len(watch.seconds) == count
    blender_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    files = [path for path in Path("aged").rglob("*") if path.is_file()]
    opened = time.perf_counter()
    bpy.ops.wm.open_mainfile(filepath=str(Path("aged.blend").absolute()))
    opened = time.perf_counter() - opened
    return dict(
        zip(
            COLUMNS,
            (
                count,
                ended - started,
                np.mean(watch.seconds[1:]),
                growth(watch.seconds),
                np.mean(watch.busy[1:]),
                growth(watch.busy),
                watch.begun[0] - started,
                ended - watch.begun[-1] - watch.seconds[-1],
                opened,
                blender_mb,
                watch.worker_mb,
                len(watch.workers),
                len(files),
                sum(path.stat().st_size for path in files) / 1e6,
                Path("aged.blend").stat().st_size / 1e6,
            ),
            strict=True,
        )
    )


def growth(seconds: list[float]) -> float:
    """What the last tenth took over what the first did, without the one that waits for a worker."""
    tenth = max(len(seconds) // 10, 1)
    return float(np.median(seconds[-tenth:]) / np.median(seconds[1 : 1 + tenth]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--counts", type=int, nargs="+", default=[10, 100])
    parser.add_argument("--size", type=int, default=16)
    parser.add_argument("--steps", type=int, default=9)
    parser.add_argument("--grows", action="store_true")
    parser.add_argument("--stub", action="store_true")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        words = ["--ntm", "rust", "--frames", "1-20", "--steps", str(arguments.steps)]
        words += ["--onset", "auto" if arguments.grows else "none"]
        print(json.dumps(measured(arguments.counts[0], arguments.size, words)), flush=True)
        session.stop_worker()
        os._exit(0)  # Blender says much at its end
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}", flush=True)
    if arguments.stub:
        os.environ |= {"TVBRDF_WORKER": str(STUB), "TVBRDF_STUB_SECONDS": "0"}
    root = Path(__file__).resolve().parents[2]
    for count in arguments.counts:
        command = [sys.executable, "-m", "tests.benchmarks.many_materials", *sys.argv[1:], "--one"]
        with tempfile.TemporaryDirectory() as folder:
            run = subprocess.run(
                [*command, "--counts", str(count)],
                cwd=folder,
                env=os.environ | {"PYTHONPATH": str(root)},
                stdout=subprocess.PIPE,
                text=True,
                check=True,
            )
        figures = json.loads(run.stdout.splitlines()[-1])
        print(f"| {' | '.join(f'{figures[name]:.4g}' for name in COLUMNS)} |", flush=True)


main()
