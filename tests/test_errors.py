"""Sentences are plain whatever they quote, and memory that runs out is one of them."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from model_runtime.errors import (
    InputError,
    OutOfMemoryError,
    TvbrdfError,
    is_plain,
    memory_in_words,
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


def caused(error: Exception, cause: Exception) -> Exception:
    error.__cause__ = cause
    return error


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        RuntimeError(
            "[enforce fail at alloc_cpu.cpp:121] err == 0. DefaultCPUAllocator: can't allocate "
            "memory: you tried to allocate 256 bytes. Error code 12 (Cannot allocate memory)"
        ),
        RuntimeError("not enough memory: you tried to allocate 256 bytes."),
        RuntimeError("CUDA out of memory. Tried to allocate 2 GiB"),
        RuntimeError("can't start new thread"),
        RuntimeError("std::bad_alloc"),
        ImportError("libtorch_cpu.so: failed to map segment from shared object"),
        caused(ImportError("numpy could not be imported"), OSError(errno.ENOMEM, "no")),
    ],
    ids=repr,
)
def test_memory_that_runs_out_is_a_sentence_in_whoever_s_words(error: Exception):
    sentence = r"not enough memory\. Go home\."
    with pytest.raises(OutOfMemoryError, match=sentence) as caught, memory_in_words("Go home."):
        raise error
    assert caught.value.code == "memory"


@pytest.mark.parametrize("error", [ValueError("x"), InputError("There is not enough memory foam.")])
def test_other_errors_stay_what_they_are(error: Exception):
    with pytest.raises(type(error)) as caught, memory_in_words("Go home."):
        raise error
    assert caught.value is error
