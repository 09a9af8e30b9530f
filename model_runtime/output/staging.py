"""The folder in which a result is made, out of sight, before it is committed."""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path

from ..contract import staging_places
from ..errors import OutputError, shown
from ..signals import undisturbed
from .commit import clear, recover
from .holding import held, hold, let_go

__all__ = ("found", "staging")


def found(folder: Path) -> Path:
    """Where `folder` is, without links on the way.

    Raises OutputError where it cannot be a folder, OSError or ValueError where it cannot be at all.
    """
    real = Path(os.path.realpath(folder))
    try:
        mode = real.stat().st_mode
    except FileNotFoundError:
        if folder.is_symlink():
            raise OutputError(
                f"{shown(folder)} is a link that leads nowhere.", "Choose another output folder."
            ) from None
        return real
    if not stat.S_ISDIR(mode):
        raise OutputError(
            f"{shown(real)} is a file, not a folder.", "Choose another output folder."
        )
    return real


@contextmanager
def staging(folder: Path) -> Iterator[Path]:
    """A new folder from which files can be moved into `folder` (`found`), held by this process.

    It and the parents that had to be made go again at the end of the block, unless a result has
    come. Raises OSError where `folder` cannot be written to.
    """
    recover(folder)
    with ExitStack() as leaving:
        new = not folder.exists()
        # Held, that nobody lets it change places with another folder meanwhile.
        with nullcontext() if new else held(folder), undisturbed():
            if new:
                _make(folder.parent, leaving)
                leaving.callback(_remove_empty, folder)
            while (staged := _staged(folder, new, leaving)) is None:
                pass
        try:
            yield staged
        finally:
            with undisturbed():
                leaving.close()


def _staged(folder: Path, new: bool, leaving: ExitStack) -> Path | None:
    """None where somebody has just taken the new folder for one that was left behind."""
    place = _place(folder, new)
    try:
        mine = hold(place)
    except (BlockingIOError, FileNotFoundError):
        return None
    except OSError:  # a file system without locks
        leaving.callback(clear, place)
        return place
    leaving.callback(clear, place)
    leaving.callback(let_go, place, mine)
    return place


def _place(folder: Path, new: bool) -> Path:
    """Make the staging folder: beside `folder`, so that the two can change places.

    Or within, where `folder` is a disk of its own, or its parent cannot be written to, or there is
    no room for a longer name.
    """
    beside, within = staging_places(folder, secrets.token_hex(4))
    try:
        beside.mkdir()
        if not new:
            beside.rename(within)
            within.rename(beside)
        return beside
    except OSError as error:
        if new and error.errno != errno.ENAMETOOLONG:
            raise
        _remove_empty(beside)
    folder.mkdir(exist_ok=True)
    within.mkdir(exist_ok=True)
    return within


def _make(folder: Path, leaving: ExitStack) -> None:
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    for each in reversed(missing):
        each.mkdir(exist_ok=True)
        leaving.callback(_remove_empty, each)


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):  # it is not there, or something lies in it: the result, as a rule
        folder.rmdir()
