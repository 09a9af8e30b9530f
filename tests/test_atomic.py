"""Files appear whole or not at all, and what cannot be written is known beforehand."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from model_runtime.atomic import check_writable, replaced
from model_runtime.errors import OutputError


def test_a_file_takes_the_place_of_another(tmp_path: Path):
    path = tmp_path / "new" / "x"
    for content in ("one", "two"):
        with replaced(path, parents=True) as beside:
            beside.write_text(content)
        assert path.read_text() == content
    assert list(path.parent.iterdir()) == [path]


def test_the_name_may_be_as_long_as_names_may_be(tmp_path: Path):
    path = tmp_path / ("x" * 200)
    with replaced(path) as beside:
        beside.write_text("one")
    assert path.read_text() == "one"


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left"), KeyboardInterrupt()])
def test_what_fails_leaves_the_earlier_one_and_nothing_else(tmp_path: Path, error: BaseException):
    path = tmp_path / "x"
    path.write_text("one")

    def fail() -> None:
        with replaced(path) as beside:
            beside.write_text("half")
            raise error

    with pytest.raises((OutputError, KeyboardInterrupt)):
        fail()
    assert path.read_text() == "one"
    assert list(tmp_path.iterdir()) == [path]


def pipe(path: Path) -> None:
    os.mkfifo(path)


@pytest.mark.parametrize("make", [Path.mkdir, pipe])
def test_only_a_file_is_replaced(tmp_path: Path, make: Callable[[Path], None]):
    path = tmp_path / "x"
    make(path)
    before = path.stat().st_mode
    with pytest.raises(OutputError, match="x cannot be written"):
        check_writable(path)
    with pytest.raises(OutputError, match="x cannot be written"), replaced(path):
        pass
    assert path.stat().st_mode == before
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_written_is_known_before(tmp_path: Path):
    (tmp_path / "file").write_text("one")
    for path in (tmp_path / "file" / "x", Path("/proc/x"), tmp_path / ("x" * 300)):
        with pytest.raises(OutputError, match="cannot be written") as caught:
            check_writable(path)
        assert len(str(caught.value)) < 600
    check_writable(tmp_path / "new" / "x")
    check_writable(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "one"
    assert list((tmp_path / "new").iterdir()) == []
