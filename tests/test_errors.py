"""Sentences are plain, whatever they quote."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from model_runtime.errors import (
    TvbrdfError,
    is_plain,
    reason,
    shown,
)


@pytest.mark.parametrize(
    ("foreign", "said"),
    [
        ("Möß 木 🌿", "Möß 木 🌿"),
        ("\x1b[2J", "\\x1b[2J"),
        ("two\nlines", "two\\nlines"),
        ("\ud800", "\\ud800"),
        ("\u202eback", "\\u202eback"),
        (None, "None"),
        (Path("a/b"), "a/b"),
    ],
)
def test_what_is_quoted_is_plain(foreign: object, said: str):
    assert shown(foreign) == said
    assert is_plain(shown(foreign))
    shown(foreign).encode()


def test_of_an_endless_text_begin_and_end_are_quoted():
    said = shown("begin " + "x" * 900_000 + " end")
    assert said.startswith("begin x")
    assert said.endswith("x end")
    assert len(said) <= 80
    assert len(shown(Path("x" * 900_000))) < 250


def test_no_sentence_is_endless_or_moves_the_cursor():
    error = TvbrdfError("It says \x1b[2J" + "x" * 900_000 + ".", "Do\nthis.")
    assert len(str(error)) < 1000
    assert "\x1b" not in str(error)
    assert error.hint == "Do\\nthis."


def test_a_reason_leaves_out_the_path():
    assert reason(OSError(errno.ENOSPC, "No space left", "/a/b")) == "No space left"
    assert reason(ValueError("bad")) == "bad"
