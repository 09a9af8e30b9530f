"""Memory that runs out is a sentence, wherever it does."""

from __future__ import annotations

import errno
import subprocess
import sys
from pathlib import Path

import pytest

from model_runtime import age
from model_runtime.errors import InputError, OutOfMemoryError
from model_runtime.memory import memory_in_words
from tests.aging import run

ROOT = Path(__file__).resolve().parents[1]


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


def test_a_run_without_memory(steel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def allocate(*_args: object, **_options: object) -> None:
        raise MemoryError

    monkeypatch.setattr(age, "model_texels", allocate)
    with pytest.raises(OutOfMemoryError, match="smaller size"):
        run(steel, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform != "linux", reason="others do not keep these limits")
@pytest.mark.parametrize("limit", ["RLIMIT_AS", "RLIMIT_DATA"])
@pytest.mark.parametrize("words", [["model_runtime", "age"], ["training", "ntm"]])
def test_where_torch_would_abort(steel: Path, tmp_path: Path, limit: str, words: list[str]):
    """Under 140 MB it does while it is loaded, past all that Python can catch."""
    module, verb = words
    options = ["--input", str(steel), "--ntm", "rust", "--output", str(tmp_path / "out")]
    if module == "training":
        options = ["--sequence", str(steel), "--encoder", "x", "--output", "x", "--name", "x"]
    limited = (
        "import resource, runpy, sys\n"
        f"resource.setrlimit(resource.{limit}, (140 << 20, 140 << 20))\n"
        f"sys.argv = {[module, verb, *options]!r}\n"
        f"runpy.run_module({module!r}, run_name='__main__', alter_sys=True)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", limited],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    assert "There is not enough memory." in done.stderr
    assert len(done.stderr.splitlines()) == 1
