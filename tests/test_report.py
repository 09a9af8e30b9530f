"""The report of a result as the panel says it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from tvbrdf.tvbrdf_addon.report import report_in

AGED = {
    "ntm": "rust",
    "frames": 36,
    "size": [512, 1024],
    "quality": "balanced",
    "temporal_model": "lstm_parameters",
    "plan": ["Modelled 214 distinct BRDFs instead of 524,288.", "Specular does not change."],
    "warnings": ["Something to know."],
    "seconds": {"read": 1.0, "onset": 0.5, "model": 0.5, "write": 6.2},
    "command": "python -m model_runtime age --temporal-model auto --onset none",
}


def written(folder: Path, **changes: object) -> Path:
    (folder / "base_color_0001.exr").write_bytes(b"0" * 8_000_000)
    (folder / "aged.json").write_text(json.dumps(AGED | changes))
    return folder


def test_what_was_modelled_written_and_said(tmp_path: Path):
    report = report_in(written(tmp_path))
    assert report.size == (512, 1024)
    assert report.sentences == (
        "Modelled 214 distinct BRDFs instead of 524,288.",
        "Specular does not change.",
        "36 frames of 1024 x 512 px, 8 MB, in 8 s at quality Balanced.",
    )
    assert report.warnings == ("Something to know.",)


@pytest.mark.parametrize(
    ("changes", "usual", "said"),
    [
        ({}, "lstm_parameters", "LSTM on Parameters, the simplest that fits"),
        ({"temporal_model": "affine"}, "lstm_latents", "Affine, because the material is unlike"),
        ({}, None, "LSTM on Parameters, chosen automatically."),
        ({"command": "age --temporal-model lstm_parameters"}, "affine", "as you chose."),
        ({"command": ""}, "lstm_parameters", "the simplest"),
    ],
)
def test_why_this_model_of_change(tmp_path: Path, changes: dict, usual: str | None, said: str):
    assert said in report_in(written(tmp_path, **changes)).change(usual)


def test_a_new_result_is_read_again(tmp_path: Path):
    assert report_in(written(tmp_path)).temporal_model == "lstm_parameters"
    written(tmp_path, temporal_model="constant")
    os.utime(tmp_path / "aged.json", ns=(1, 1))
    assert report_in(tmp_path).temporal_model == "constant"


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"size": 3}', '{"command": "age \'"}'])
def test_no_report_where_it_is_damaged_or_gone(tmp_path: Path, text: str):
    assert report_in(tmp_path) is None
    (tmp_path / "aged.json").write_text(text)
    assert report_in(tmp_path) is None
