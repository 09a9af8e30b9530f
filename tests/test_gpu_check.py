"""`make gpu-check` where there is no GPU: it says so, and its parts run on the CPU."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import torch

from tests.benchmarks import gpu_check
from tests.trainings import small

pytestmark = pytest.mark.usefixtures("one_thread")


def test_without_one_it_is_a_sentence_and_exit_code_2(monkeypatch, capsys):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(sys, "argv", ["gpu_check"])
    assert gpu_check.main() == 2
    assert capsys.readouterr().err == ("PyTorch finds no device cuda here: nothing was checked.\n")


def test_its_table_has_every_part(data_folder, monkeypatch, tmp_path: Path):
    recipe = small("fast", iterations=2, looks=1, pixels=1)
    monkeypatch.setattr(gpu_check, "RECIPE", recipe)
    monkeypatch.setattr(gpu_check, "BATCHES", (4, 8))
    monkeypatch.setattr(gpu_check, "AGE_SECONDS", 600)  # the machine may be busy
    output = tmp_path / "new" / "table.md"
    words = ["--device", "cpu", "--seconds", "0.1", "--sizes", "16", "--output", str(output)]
    monkeypatch.setattr(sys, "argv", ["gpu_check", *words])
    assert gpu_check.main() == 0
    rows = [line.split(" | ") for line in output.read_text().splitlines() if line[:2] == "| "]
    assert [row[0].strip("| ") for row in rows[1:]] == [
        "tests that need a GPU",
        "age 16 x 16, s",
        "of these modeling, s",
        "encoder, 4 materials a step, steps/s",
        "encoder, 8 materials a step, steps/s",
        "encoder of 0.1 s: steps; dB",
    ]
    assert all(float(number) > 0 for row in rows[2:6] for number in (row[1], row[2].strip("| ")))
    assert "merl_held_out" in rows[6][2]
