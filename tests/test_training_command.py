"""The command `python -m training`: exit codes, and sentences where it cannot do what was asked."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from safetensors.torch import load_file

import training.__main__ as command
from model_runtime.model_files.weights import ENCODER
from training.data import weathering

ROOT = Path(__file__).resolve().parents[1]


def call(monkeypatch: pytest.MonkeyPatch, *words: str | Path) -> int | str | None:
    monkeypatch.setattr(sys, "argv", ["training", *map(str, words)])
    try:
        return command.main()
    except SystemExit as ended:
        return ended.code


@pytest.mark.parametrize(
    "words",
    [
        ["encoder"],
        ["encoder", "--output", "x", "--config", "huge"],
        ["encoder", "--output", "x", "--minutes", "many"],
        ["encoder", "--output", "x", "--device", "tpu"],
        ["encoder", "--output", "x", "--device", "cuda:99"],
        ["encoder", "--output", "x", "--batch", "1"],
        ["ntm", "--sequence", "x", "--output", "y"],
        ["ntm", "--encoder", "x", "--output", "y", "--name", "z", "--sequence"],
        [
            "ntm",
            "--encoder",
            "x",
            "--output",
            "y",
            "--name",
            "z",
            "--sequence",
            "s",
            "--texels",
            "0",
        ],
        ["sing"],
        ["evaluate", "everything", "--output", "x"],
    ],
    ids=" ".join,
)
def test_wrong_usage_is_exit_code_2(monkeypatch, tmp_path, capsys, words):
    monkeypatch.chdir(tmp_path)
    assert call(monkeypatch, *words) == 2
    assert list(tmp_path.iterdir()) == []


def test_a_failure_is_one_sentence_and_exit_code_1(monkeypatch, tmp_path, capsys):
    words = ["ntm", "--sequence", tmp_path / "none", "--encoder", ENCODER, "--name", "moss"]
    code = call(monkeypatch, *words, "--output", tmp_path / "moss.safetensors")
    assert code == 1
    said = capsys.readouterr().err
    assert "There is no folder" in said
    assert "Traceback" not in said


@pytest.mark.parametrize("seed", ["-1", str(1 << 64)])
def test_a_seed_out_of_range(monkeypatch, tmp_path, capsys, seed: str):
    words = ["weathering", "rust", "--output", tmp_path / "s", "--seed", seed]
    assert call(monkeypatch, *words) == 2
    assert "seed" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_system_s_errors_are_a_sentence_too(monkeypatch, tmp_path, capsys):
    def fail(*args, **options):
        raise OSError(28, "No space left on device", "/a/b")

    monkeypatch.setattr(weathering, "write", fail)
    words = ["weathering", "rust", "--output", tmp_path / "s"]
    assert call(monkeypatch, *words) == 1
    assert capsys.readouterr().err == "/a/b: No space left on device.\n"


def test_ctrl_c_is_exit_code_130_and_keeps_the_checkpoint(rusting, tmp_path):
    """While the second LSTM is trained: the first has its checkpoint."""
    output = tmp_path / "moss.safetensors"
    checkpoint = tmp_path / "moss.parameters.checkpoint.safetensors"
    words = ["ntm", "--sequence", rusting, "--encoder", ENCODER, "--output", output]
    child = subprocess.Popen(
        [sys.executable, "-m", "training", *map(str, words), "--name", "x", "--minutes", "0.1"],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
        # Tests may run in the background, whose children would not hear it.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        deadline = time.monotonic() + 120
        while not checkpoint.exists() and time.monotonic() < deadline:
            time.sleep(0.02)
        child.send_signal(signal.SIGINT)
        _, said = child.communicate(timeout=60)
    finally:
        child.kill()
    assert child.returncode == 130
    assert "--resume" in said.splitlines()[-1]
    assert "Traceback" not in said
    assert load_file(checkpoint)
    assert not output.exists()
    assert not list(tmp_path.glob(".*"))


def test_a_missing_data_folder(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("TVBRDF_DATA", str(tmp_path / "none"))
    code = call(monkeypatch, "encoder", "--output", tmp_path / "e.safetensors")
    assert code == 1
    assert "TVBRDF_DATA" in capsys.readouterr().err


@pytest.mark.parametrize("minutes", ["0", "-1", "nan", "inf", "1e300"])
def test_no_time_is_no_training(monkeypatch, tmp_path, capsys, minutes: str):
    code = call(
        monkeypatch, "encoder", "--output", tmp_path / "e.safetensors", "--minutes", minutes
    )
    assert code == 2
    assert "minutes" in capsys.readouterr().err


def test_weathering_writes_a_sequence(monkeypatch, tmp_path):
    words = ["weathering", "rust", "--output", tmp_path / "s", "--size", "8", "--frames", "3"]
    assert call(monkeypatch, *words) == 0
    assert len(list((tmp_path / "s").glob("kd_*.exr"))) == 3


def test_ctrl_c_while_it_is_loaded_is_no_traceback(tmp_path: Path):
    (tmp_path / "tyro.py").write_text("raise KeyboardInterrupt\n")
    code = (
        f"import runpy, sys\nsys.path.insert(0, {str(tmp_path)!r})\n"
        "runpy.run_module('training', run_name='__main__', alter_sys=True)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert (done.returncode, done.stderr) == (130, "")
