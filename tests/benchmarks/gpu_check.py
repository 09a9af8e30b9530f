"""What a GPU gains, and whether it computes what the CPU does: `make gpu-check`, in eight minutes.

    python -m tests.benchmarks.gpu_check [--device cuda] [--seconds 180] [--sizes 1024 4096]
        [--output out/gpu-check.md]

Runs the tests that need a GPU, ages a painted steel on the device and on the CPU, by the LSTM on
latents, which is what a GPU is used for; counts the steps a second of an encoder's training on
both; and trains one for so many `--seconds` on the device.  The table is printed and written.  It
needs the data (`TVBRDF_DATA`).  Exit code 0: done; 1: a test failed; 2: there is no such device.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import torch

from model_runtime.device import device_of
from model_runtime.errors import UsageError
from model_runtime.model_files.weights import read_card
from tests.aging import write_painted_steel
from tests.benchmarks.training_speed import speed
from training.distributed import joined
from training.encoder import CONFIGS, train_encoder

TITLE = "What a GPU gains, and whether it computes what the CPU does."
ROOT = Path(__file__).resolve().parents[2]
TESTS = "tests/test_cuda.py"
RECIPE = replace(CONFIGS["fast"], looks=4, distillation=100)
BATCHES = (RECIPE.batch, 16 * RECIPE.batch)
SPEED = 1 / 18  # of the seconds, to count steps in
TEST_SECONDS = 90  # at most
AGE_SECONDS = 45  # at most, each run

Row = tuple[str, ...]  # what, on the CPU, on the device


def main() -> int:
    """Run the command line; its exit code."""
    parser = argparse.ArgumentParser(description=TITLE)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--seconds", type=float, default=180.0)
    parser.add_argument("--sizes", type=int, nargs="+", default=[1024, 4096])
    parser.add_argument("--output", type=Path, default=Path("out/gpu-check.md"))
    asked = parser.parse_args()
    try:
        device = device_of(asked.device)
    except UsageError:
        print(f"PyTorch finds no device {asked.device} here: nothing was checked.", file=sys.stderr)
        return 2
    gpu = device.type == "cuda"
    passed, tests = run_tests() if gpu else (True, "none: no GPU")
    rows: list[Row] = [("tests that need a GPU", "", tests)]
    with tempfile.TemporaryDirectory() as folder:
        for size in asked.sizes:
            rows += aged(Path(folder), size, asked.device)
        rows += [speeds(asked.device, batch, asked.seconds * SPEED) for batch in BATCHES]
        rows.append(trained(Path(folder), asked.device, asked.seconds))
    name = torch.cuda.get_device_name(device) if gpu else "CPU"
    table = "\n".join(
        (
            f"{time.strftime('%d %B %Y', time.gmtime())}, PyTorch {torch.__version__}:",
            "",
            f"| | CPU, {torch.get_num_threads()} threads | {name} |",
            "|---|---|---|",
            *("| " + " | ".join(row) + " |" for row in rows),
        )
    )
    print(table)
    asked.output.parent.mkdir(parents=True, exist_ok=True)
    asked.output.write_text(table + "\n", encoding="utf-8")
    return 0 if passed else 1


def run_tests() -> tuple[bool, str]:
    """Whether the tests that need a GPU passed, and in words."""
    command = [sys.executable, "-m", "pytest", "-q", "--no-header", TESTS]
    try:
        done = subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=TEST_SECONDS
        )
    except subprocess.TimeoutExpired:
        return False, f"not done in {TEST_SECONDS} s"
    print(done.stdout, file=sys.stderr)
    counts = re.findall(r"\d+ (?:passed|failed|skipped|errors?)", done.stdout)
    return done.returncode == 0, ", ".join(counts) or "did not start"


def aged(folder: Path, size: int, device: str) -> tuple[Row, Row]:
    """How long a run of `age` takes on a material of `size` x `size` texels, by its own account,
    and its modeling, the part of it that a GPU does.
    """
    source = write_painted_steel(folder / f"steel_{size}", size)
    runs = [_age(source, folder / f"{size}_{k}", on) for k, on in enumerate(("cpu", device))]
    whole, modeling = zip(*runs, strict=True)
    return (f"age {size:,} x {size:,}, s", *whole), ("of these modeling, s", *modeling)


def _age(source: Path, output: Path, device: str) -> tuple[str, str]:
    command = [sys.executable, "-m", "model_runtime", "age", "--input", str(source)]
    command += ["--output", str(output), "--ntm", "char", "--temporal-model", "lstm_latents"]
    command += ["--cache-gb", "0"]
    try:
        done = subprocess.run(
            [*command, "--device", device],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
            timeout=AGE_SECONDS,
        )
    except subprocess.TimeoutExpired:
        return f"over {AGE_SECONDS}", ""
    if done.returncode != 0:
        raise SystemExit(done.stderr)
    report = json.loads((output / "aged.json").read_text(encoding="utf-8"))
    assert report["device"].startswith(device.partition(":")[0]), report["device"]
    seconds = report["seconds"]
    return f"{sum(seconds.values()):.2f}", f"{seconds['model']:.2f}"


def speeds(device: str, batch: int, seconds: float) -> Row:
    """Steps a second of an encoder's training with so many materials a step."""
    found = []
    for on in ("cpu", device):
        with joined(on) as world:
            found.append(f"{speed(world, batch, seconds).steps:.1f}")
    return (f"encoder, {batch:,} materials a step, steps/s", *found)


def trained(folder: Path, device: str, seconds: float) -> Row:
    """Of an encoder that was trained for so many seconds: its steps and its last look."""
    CONFIGS["gpu-check"] = RECIPE
    output = folder / "encoder.safetensors"
    with joined(device) as world:
        train_encoder(config="gpu-check", output=output, minutes=seconds / 60, world=world)
    found = read_card(output).trained
    last = found["curve"][-1]
    scores = ", ".join(f"{name} {last[name]}" for name in ("merl_held_out", "rgl"))
    return (f"encoder of {seconds:g} s: steps; dB", "", f"{found['iterations']:,}; {scores}")


if __name__ == "__main__":
    os.environ["PYTHONUNBUFFERED"] = "1"
    sys.exit(main())
