"""Measures how fast an aged material can be scrubbed: in a window, and in Cycles without one.

    python -m tests.benchmarks.scrubbing OUTPUT_FOLDER [RESULT_FOLDER ...] [--sizes 1024 4096]
        [--frames 9] [--no-window]

A result is what `age` wrote, `aged.json` and its files.  Without any, random ones are made: one
with a file for each frame, one with a file for every fourth, and a live one, of each size.  Prints
and leaves `scrubbing.json`.  The window is that of `tests/blender/windowed.py`, whose
OpenGL is software: compare its figures with those of the same scene unaged, not with a GPU's.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from model_runtime.images import write_exr
from tests.blender.live_cases import made_up_live
from tests.blender.windowed import AVAILABLE, run_in_window

HERE = Path(__file__).resolve().parent
EVERY = 4
COEFFICIENTS = (0, 4, 12)
CHANNELS = {"base_color": 3, "metallic": 1, "specular": 1, "roughness": 1}
WINDOW_SECONDS = 1500


def make_result(folder: Path, size: int, frames: int, every: int) -> Path:
    """Random maps that all change, stored for one modeled frame in `every` and for the last."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    stored = [*range(0, frames - 1, every), frames - 1]
    files: dict[str, list[object]] = {}
    for name, channels in CHANNELS.items():
        shape = (size, size) if channels == 1 else (size, size, channels)
        # As rough as a photographed surface, so that files are as large as a real result's.
        first, last = (rng.random(2)[i] + 0.1 * rng.random(shape, np.float32) for i in (0, 1))
        for frame in stored:
            t = frame / (frames - 1)
            write_exr(folder / file_of(name, frame), (1 - t) * first + t * last)
        files[name] = [mix(name, frame, stored) for frame in range(frames)]
    aged = {
        "format": "principled",
        "ntm": "rust",
        "frames": frames,
        "times": [frame / (frames - 1) for frame in range(frames)],
        "size": [size, size],
        "files": files,
        "warnings": [],
    }
    (folder / "aged.json").write_text(json.dumps(aged), encoding="utf-8")
    return folder


def mix(name: str, frame: int, stored: list[int]) -> object:
    """Which stored files, with which weights, make a frame, as `aged.json` says it."""
    if frame in stored:
        return file_of(name, frame)
    before = max(each for each in stored if each < frame)
    after = min(each for each in stored if each > frame)
    share = (frame - before) / (after - before)
    return [[file_of(name, before), 1 - share], [file_of(name, after), share]]


def file_of(name: str, frame: int) -> str:
    return f"{name}_{frame + 1:04d}.exr"


def gather(results: list[Path], place: Path, sizes: list[int], frames: int) -> list[Path]:
    """The results to measure, all in `place`, where the window's Blender can see them."""
    shutil.rmtree(place, ignore_errors=True)
    for result in results:
        shutil.copytree(result, place / result.name)
    if not results:
        for size in sizes:
            for kind, every in (("every_frame", 1), ("sparse", EVERY)):
                make_result(place / f"{kind}_{size}", size, frames, every)
            for count in COEFFICIENTS:
                made_up_live(place / f"live_{count}_{size}", count=count, size=(size, size))
    return sorted(place.iterdir())


def in_cycles(folder: Path, output: Path) -> list[dict[str, object]]:
    found = []
    for data in ("anew", "persistent"):
        script = [sys.executable, str(HERE / "scrub_in_cycles.py"), str(folder)]
        report = output / "cycles.json"
        run = subprocess.run([*script, str(report), data], capture_output=True, text=True)
        if run.returncode:
            raise SystemExit(f"{folder.name}: {run.stdout[-3000:]}{run.stderr[-3000:]}")
        found.append(json.loads(report.read_text(encoding="utf-8")))
        report.unlink()
    return found


def in_window(output: Path) -> dict[str, object]:
    run_in_window(
        HERE / "scrub_in_window.py",
        output,
        HERE / "scrub_scene.py",
        seconds=WINDOW_SECONDS,
        screen="800x600",
    )
    return json.loads((output / "window.json").read_text(encoding="utf-8"))


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure how fast aged materials are scrubbed.")
    parser.add_argument("output", type=Path, metavar="OUTPUT_FOLDER")
    parser.add_argument("results", type=Path, nargs="*", metavar="RESULT_FOLDER")
    parser.add_argument("--sizes", type=int, nargs="+", default=[1024, 4096], metavar="PX")
    parser.add_argument("--frames", type=int, default=9, metavar="N")
    parser.add_argument("--no-window", action="store_true", help="Cycles alone")
    arguments = parser.parse_args()
    output = arguments.output.resolve()
    folders = gather(arguments.results, output / "results", arguments.sizes, arguments.frames)
    report: dict[str, object] = {
        "cycles": [each for folder in folders for each in in_cycles(folder, output)]
    }
    if not arguments.no_window and AVAILABLE:
        report["window"] = in_window(output)
    text = json.dumps(report, indent=1)
    (output / "scrubbing.json").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
