"""What reports keep under the identity of what it was made from."""

from __future__ import annotations

from pathlib import Path

import pytest

from training.evaluation.bench import kept
from training.evaluation.bench.kept import code, kept_json


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a program of three files."""
    monkeypatch.setattr(kept, "_PACKAGES", tmp_path)
    for name in ("model_runtime/age.py", "training/learn.py", "training/evaluation/report.py"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("1\n", encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize(
    ("file", "same"),
    [
        ("model_runtime/age.py", False),
        ("training/learn.py", False),
        ("training/evaluation/report.py", True),
    ],
)
def test_what_another_program_learned_is_learned_again(program: Path, file: str, same: bool):
    def told() -> str:
        code.cache_clear()
        return code()

    try:
        first = told()
        (program / file).write_text("2\n", encoding="utf-8")
        assert (told() == first) == same
    finally:
        code.cache_clear()


def test_what_is_kept_is_made_again_where_it_was_made_from_else_or_is_damaged(tmp_path: Path):
    path, made = tmp_path / "kept" / "value.json", iter(range(9))
    assert kept_json(path, "a", lambda: next(made)) == 0
    assert kept_json(path, "a", lambda: next(made)) == 0
    assert kept_json(path, "b", lambda: next(made)) == 1
    path.write_text("{", encoding="utf-8")
    assert kept_json(path, "b", lambda: next(made)) == 2
