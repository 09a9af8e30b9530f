"""Folders that one living process holds: the system lets go of them however the process ended."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import OutputError, shown

__all__ = ("held", "hold", "let_go")

_PATIENCE = 30.0  # seconds; whoever holds a folder to commit needs milliseconds
_PAUSE = 0.02
_LOCK_FILE = ".aged.lock"  # on Windows, where a folder itself cannot be locked


def hold(folder: Path) -> int:
    """Hold `folder`; returns what `let_go` takes.

    Raises BlockingIOError where somebody who lives holds it, and another OSError where it is not
    there or lies on a file system without locks.
    """
    if sys.platform == "win32":
        return _hold_file(folder / _LOCK_FILE)
    import fcntl

    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not os.path.samestat(os.fstat(descriptor), folder.stat()):
            raise BlockingIOError(f"Another folder has taken the place of {folder}.")
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def _hold_file(path: Path) -> int:
    import msvcrt

    descriptor = os.open(path, os.O_RDWR | os.O_CREAT)
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    except OSError as error:
        os.close(descriptor)
        raise BlockingIOError(f"{path} is locked.") from error
    return descriptor


def let_go(folder: Path, held: int) -> None:
    os.close(held)
    if sys.platform == "win32":
        with suppress(OSError):  # the next one to hold it has opened the file already
            (folder / _LOCK_FILE).unlink()


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold `folder` within the block, which is waited for, though not for ever.

    A file system without locks is taken as it is. Raises OutputError where somebody holds `folder`
    for 30 s.
    """
    deadline = time.monotonic() + _PATIENCE
    while True:
        try:
            descriptor = hold(folder)
        except BlockingIOError as error:
            if time.monotonic() > deadline:
                raise OutputError(
                    f"Another run has been writing to {shown(folder)} for {_PATIENCE:.0f} seconds.",
                    "Wait for it to end, or end it; or choose another output folder.",
                ) from error
            time.sleep(_PAUSE)
        except OSError:
            yield
            return
        else:
            break
    try:
        yield
    finally:
        let_go(folder, descriptor)
