"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import OutputError, reason, shown

__all__ = ("check_writable", "replaced")


@contextmanager
def replaced(path: Path, *, parents: bool = False) -> Iterator[Path]:
    """A path beside `path` to write to: what is there in the end takes the place of `path`.

    If anything fails meanwhile, nothing is left beside and `path` holds what it held. An OSError
    becomes an OutputError; so does a `path` that is a folder or a device. `parents` makes the
    folder.
    """
    with _beside(path, parents=parents) as beside:
        yield beside
        beside.replace(path)


def check_writable(path: Path) -> None:
    """Raise the OutputError now that `replaced(path, parents=True)` would raise after the work."""
    with _beside(path, parents=True) as beside:
        beside.touch()


@contextmanager
def _beside(path: Path, *, parents: bool) -> Iterator[Path]:
    try:
        if path.exists() and not stat.S_ISREG(path.stat().st_mode):
            raise OSError(errno.EEXIST, "it is a folder, or no file that could be replaced")
        if parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_name(f".{path.name}.{os.getpid()}.partial")
        try:
            yield beside
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            f"{shown(path)} cannot be written: {reason(error)}.",
            "Choose a file in an existing folder that can be written to, with space left.",
        ) from error
