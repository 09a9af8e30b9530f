"""The report of a result as the panel says it."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tvbrdf.model_runtime.errors import is_plain
from tvbrdf.tvbrdf_addon.sentences import report_in

AGED = {
    "ntm": "rust",
    "frames": 36,
    "size": [512, 1024],
    "quality": "balanced",
    "temporal_model": "lstm_parameters",
    "plan": ["Modeled 214 texels for all 524,288.", "Specular does not change."],
    "warnings": ["Something to know."],
    "seconds": {"read": 1.0, "onset": 0.5, "model": 0.5, "write": 6.2},
    "command": "python -m model_runtime age --temporal-model auto --onset none",
}


def written(folder: Path, **changes: object) -> Path:
    (folder / "base_color_0001.exr").write_bytes(b"0" * 8_000_000)
    (folder / "aged.json").write_text(json.dumps(AGED | changes))
    return folder


def test_what_was_modeled_written_and_said(tmp_path: Path):
    report = report_in(written(tmp_path))
    assert report.size == (512, 1024)
    assert report.sentences == (
        "Modeled 214 texels for all 524,288.",
        "Specular does not change.",
        "36 frames of 1024 x 512 px, 8 MB, in 8 s at quality Balanced.",
    )
    assert report.warnings == ("Something to know.",)


def test_a_result_that_was_kept_is_told_from_one_that_was_made(tmp_path: Path):
    *_, took, kept = report_in(written(tmp_path, cache_seconds=0.1)).sentences
    assert "in 8 s at" in took
    assert kept == "Kept from an earlier run of the very same, which took that time."


@pytest.mark.parametrize(("device", "said"), [("cpu", "8 s at"), ("cuda", "8 s on cuda at")])
def test_another_device_than_the_cpu_is_said(tmp_path: Path, device: str, said: str):
    assert said in report_in(written(tmp_path, device=device)).sentences[-1]


@pytest.mark.parametrize(
    ("changes", "usual", "said"),
    [
        ({}, "lstm_parameters", "Network, the simplest that fits"),
        ({"temporal_model": "affine"}, "lstm_latents", "Scale and Offset, because the material"),
        ({}, None, "Network, chosen automatically."),
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


def fifo(path: Path) -> None:
    os.mkfifo(path)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def gigantic(path: Path) -> None:
    with path.open("wb") as file:
        file.write(b'{"size": [')
        file.truncate(1 << 40)


def many_numbers(path: Path) -> None:
    path.write_text(json.dumps(AGED | {"times": [0] * 5_000_000}))


@pytest.mark.parametrize("make", [fifo, device, gigantic, many_numbers, Path.mkdir])
def test_whatever_lies_there_is_looked_at_and_left_at_once(tmp_path: Path, make: Callable):
    """Drawing a panel must not wait: the time is that of one drawn frame, or a few."""
    make(tmp_path / "aged.json")
    started = time.perf_counter()
    assert report_in(tmp_path) is None
    assert report_in(tmp_path) is None
    assert time.perf_counter() - started < 1


WRONG = (
    None,
    True,
    "x",
    [],
    {},
    -1,
    1.5,
    10**400,
    float("nan"),
    float("inf"),
    "\udce9",
    ["\x1b[2J"],
)


@pytest.mark.parametrize("field", [*AGED, "size.0", "seconds.read", "plan.0", "warnings.0"])
@pytest.mark.parametrize("wrong", WRONG, ids=lambda wrong: ascii(wrong)[:12])
def test_what_it_says_can_be_drawn_or_is_no_report(tmp_path: Path, field: str, wrong: object):
    aged = json.loads(json.dumps(AGED))
    part, _, inner = field.partition(".")
    if inner:
        aged[part][int(inner) if inner.isdigit() else inner] = wrong
    else:
        aged[part] = wrong
    (tmp_path / "aged.json").write_text(json.dumps(aged))
    if (report := report_in(tmp_path)) is not None:
        for text in (report.ntm, report.change("affine"), *report.sentences, *report.warnings):
            assert is_plain(text) and len(text) < 1000
        assert "inf" not in report.sentences[-1] and "nan" not in report.sentences[-1]
        assert all(0 < side < 2**31 for side in report.size)


def test_endless_text_has_an_end(tmp_path: Path):
    report = report_in(written(tmp_path, plan=["x" * 900_000] * 7, warnings=["y" * 900_000]))
    assert sum(map(len, report.sentences)) < 50_000
    report = report_in(written(tmp_path, plan=["x" * 9000] * 200, command="--seed " * 100_000))
    assert 1000 < sum(map(len, report.sentences)) < 50_000


@pytest.mark.parametrize(
    "text",
    [
        *("", "[]", "{}", '{"size": 3}', '{"command": "age \'"}'),
        *("[" * 100_000, '{"size":' * 100_000, "\x00", "NaN"),
    ],
    ids=lambda text: text[:12],
)
def test_no_report_where_it_is_damaged_or_gone(tmp_path: Path, text: str):
    assert report_in(tmp_path) is None
    (tmp_path / "aged.json").write_text(text)
    assert report_in(tmp_path) is None
