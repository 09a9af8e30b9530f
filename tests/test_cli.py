"""`python -m model_runtime`: exit codes and what goes where, with the stub for the computing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from model_runtime.package import save_model

ROOT = Path(__file__).resolve().parents[1]
STUB = Path(__file__).with_name("stub_worker.py")


def command(*words: str | Path, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(STUB), *map(str, words)],
        capture_output=True,
        text=True,
        cwd=cwd,
        env=os.environ | {"TVBRDF_STUB_SECONDS": "0"},
        check=False,
    )


def test_json_on_stdout_and_nothing_else_there(tmp_path: Path):
    out = tmp_path / "out"
    done = command(
        "age", "--input", tmp_path, "--ntm", "rust", "--output", out, "--frames", 3, "--json"
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == json.loads((out / "aged.json").read_text())
    assert "100%" in done.stderr or "writing" in done.stderr
    assert "a library prints this" in done.stderr
    assert "Warning: The stub paints flat colours." in done.stderr


def test_without_json_a_sentence(tmp_path: Path):
    out = tmp_path / "out"
    done = command("age", "--input", tmp_path, "--ntm", "rust", "--output", out, "--frames", 3)
    assert done.returncode == 0
    assert "3 frames of 16 x 16" in done.stdout
    assert str(out) in done.stdout


def test_a_failure_is_one_sentence_and_exit_code_1(tmp_path: Path):
    done = command("age", "--input", tmp_path / "no", "--ntm", "rust", "--output", tmp_path / "out")
    assert done.returncode == 1
    assert done.stdout == ""
    assert "There is no input at" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--frames", "0"], "--frames"),
        (["--frames", "-1"], "--frames"),
        (["--frames", "many"], "--frames"),
        (["--size", "0"], "--size"),
        (["--quality", "best"], "--quality"),
        (["--temporal-model", "x"], "--temporal-model"),
        (["--tolerance", "nan"], "--tolerance"),
        (["--seed", "-2"], "--seed"),
        (["--format", "png"], "--format"),
        (["--surprise"], "--surprise"),
    ],
)
def test_wrong_usage_is_exit_code_2(tmp_path: Path, options: list[str], word: str):
    out = tmp_path / "out"
    done = command("age", "--input", tmp_path, "--ntm", "rust", "--output", out, *options)
    assert done.returncode == 2
    assert word in done.stderr
    assert not out.exists()


@pytest.mark.parametrize("words", [[], ["age"], ["sing"], ["serve", "--idle-minutes", "0"]])
def test_incomplete_commands_are_exit_code_2(words: list[str]):
    assert command(*words).returncode == 2


def test_info_needs_neither_torch_nor_numpy(tmp_path: Path):
    model = tmp_path / "moss.safetensors"
    card = {"name": "moss", "title": "Moss", "description": "Grows", "temporal_model": "affine"}
    save_model(model, {"weight": torch.zeros(2)}, card, kind="ntm")
    code = (
        "import sys\n"
        "for name in ('torch', 'numpy', 'OpenEXR', 'safetensors'): sys.modules[name] = None\n"
        "from model_runtime.cli import main\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "info", "--ntm", str(model), "--json"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=True,
    )
    (listed,) = json.loads(done.stdout)
    assert listed.items() >= card.items()


def test_info_on_a_file_that_is_no_model(tmp_path: Path):
    (tmp_path / "broken.safetensors").write_bytes(b"\x07")
    done = command("info", "--ntm", tmp_path / "broken.safetensors")
    assert done.returncode == 1
    assert "broken.safetensors" in done.stderr


def test_a_python_without_torch_is_told_what_to_do(tmp_path: Path):
    code = (
        "import sys\nsys.modules['torch'] = None\n"
        "from model_runtime.cli import main\nsys.exit(main(sys.argv[1:]))"
    )
    words = ["age", "--input", str(tmp_path), "--ntm", "rust", "--output", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 1
    assert "Worker Python" in done.stderr
    assert "Traceback" not in done.stderr
