"""Puts a staged result into its folder: whole or not at all, at whatever point the process ends.

A staging folder lies beside the result's folder, or within where that is a disk of its own, and is
held (`holding`) by the process that fills it: one that nobody holds was left by a process that was
killed. There are three ways in, and the first that is open is taken:

1. Where there is no folder yet, the staging folder becomes it.
2. Where the folder holds files only, those that are not ours are linked into the staging folder,
   and the two change names in one step. Only Linux can.
3. Else file by file: what is to be replaced moves aside, into the staging folder, the new files
   move to its place, and the report last. Until that has moved everything can be put back, at once
   where a file cannot be moved, or by the next who comes (`recover`).

This holds against the end of the process, not against the loss of power: nothing is forced onto
the disk. Standard library only.
"""

from __future__ import annotations

import ctypes
import errno
import glob
import json
import os
import shutil
import stat
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..contract import EARLIER, REPORT, is_result_file, staging_places
from ..errors import OutputError, shown
from ..signals import undisturbed
from .holding import held, hold, let_go

__all__ = ("clear", "commit", "is_free", "listed", "recover", "require_free")

_MOST_REPORTED = 1 << 26  # bytes
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2


def is_free(folder: Path) -> bool:
    """Whether a result may go to `folder`: it is not there, is empty, or holds one already."""
    if not folder.exists():
        return True
    if not folder.is_dir():
        return False
    return _reported(folder) is not None or set(folder.iterdir()) <= set(_stagings(folder))


def require_free(folder: Path, names: Collection[str]) -> None:
    """Raise OutputError where a file of `names`, or the report, would replace what is not ours."""
    reported = _reported(folder)
    ours = set() if reported is None else reported | {REPORT}
    taken = [
        name
        for name in (REPORT, *names)
        if os.path.lexists(folder / name) and (name not in ours or _is_folder(folder / name))
    ]
    if taken:
        others = f" and {len(taken) - 1} more files" if len(taken) > 1 else ""
        raise OutputError(
            f"{shown(folder)} holds {taken[0]}{others}, which no run has written and this one "
            "would replace.",
            "Move away what is yours, or choose another output folder.",
        )


def commit(staging: Path, folder: Path, names: Collection[str]) -> None:
    """Move the files `names` and the report from `staging` into `folder`, for an earlier result.

    The report lists them. Raises OutputError or OSError where that cannot be done; `folder` is then
    as it was.
    """
    assert set(names) <= (_reported(staging) or set()), "what is not listed cannot be put back"
    if not folder.exists():
        try:
            staging.rename(folder)
            return
        except OSError:  # Windows, where `staging` holds an open file; or another run was first
            folder.mkdir(exist_ok=True)
    with held(folder), undisturbed():
        _recover(folder)
        require_free(folder, names)
        earlier = {name for name in _reported(folder) or () if os.path.lexists(folder / name)}
        earlier = {name for name in earlier if not _is_folder(folder / name)}
        if not _exchanged(staging, folder, {*names, REPORT}, {*earlier, REPORT}):
            _move(staging, folder, names, earlier)


def recover(folder: Path) -> None:
    """Tidy up after processes that were killed while they staged or committed for `folder`.

    Where another process commits at this moment, that one does it.
    """
    if next(_stagings(folder), None) is None:
        return
    if not folder.exists():
        _recover(folder)
        return
    try:
        descriptor = hold(folder)
    except OSError:
        return
    try:
        with undisturbed():
            _recover(folder)
    finally:
        let_go(folder, descriptor)


def clear(staging: Path) -> None:
    """Remove `staging`, unless files of an earlier result in it still wait to be put back."""
    if not _is_unfinished(staging):
        shutil.rmtree(staging, ignore_errors=True)


def _exchanged(staging: Path, folder: Path, new: set[str], old: set[str]) -> bool:
    """Let the folders change names where that does the same as moving the files, in one step."""
    there = _names(folder)
    try:
        if not (
            sys.platform == "linux"
            and staging.parent == folder.parent
            and _names(staging) == new
            and _owners(staging) == _owners(folder)
            and not folder.samefile(Path.cwd())
        ):
            return False
        for name in there - old:
            os.link(folder / name, staging / name, follow_symlinks=False)
        for name in there & old:
            # What must not be linked must not be removed either: its owner has locked it.
            os.link(folder / name, staging / EARLIER, follow_symlinks=False)
            (staging / EARLIER).unlink()
        shutil.copystat(folder, staging)
        os.utime(staging)
        _exchange(staging, folder)
    except OSError:
        return False
    with suppress(OSError):
        for name in _names(staging) - old:
            if not _is_same(staging / name, folder / name):  # it has just come, or been saved
                (staging / name).replace(folder / name)
    return True


def _exchange(one: Path, other: Path) -> None:
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if renameat2 is None:  # of a C library that does not know it
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))
    paths = os.fsencode(one), os.fsencode(other)
    if renameat2(_AT_FDCWD, paths[0], _AT_FDCWD, paths[1], _RENAME_EXCHANGE):
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))


def _move(staging: Path, folder: Path, names: Collection[str], earlier: Collection[str]) -> None:
    aside = staging / EARLIER
    aside.mkdir()
    try:
        for name in earlier:
            (folder / name).rename(aside / name)
        for name in names:
            (staging / name).rename(folder / name)
        (staging / REPORT).replace(folder / REPORT)
    except BaseException:
        _put_back(staging, folder)
        raise


def _is_unfinished(staging: Path) -> bool:
    """Whether a commit by moving has begun and its last step, the report's, is not done."""
    return (staging / EARLIER).is_dir() and (staging / REPORT).exists()


def _put_back(staging: Path, folder: Path) -> None:
    """Undo an unfinished `_move`, backwards, so that it may be interrupted and begun again."""
    for name in _reported(staging) or ():
        if not os.path.lexists(staging / name) and os.path.lexists(folder / name):
            (folder / name).rename(staging / name)
    aside = staging / EARLIER
    for name in _names(aside):
        (aside / name).replace(folder / name)
    aside.rmdir()


def _recover(folder: Path) -> None:
    """As `recover`, by whoever holds `folder`."""
    for staging in _stagings(folder):
        try:
            descriptor = hold(staging)
        except OSError:
            continue  # its owner lives
        try:
            if _is_unfinished(staging) and folder.exists():
                _put_back(staging, folder)
            # Still held: who has just made it, and was about to hold it, makes another.
            shutil.rmtree(staging, ignore_errors=True)
        finally:
            let_go(staging, descriptor)
        with suppress(OSError):  # gone, but on Windows, where what held it lay in it
            staging.rmdir()


def _stagings(folder: Path) -> Iterator[Path]:
    for place in staging_places(folder, ""):
        for found in place.parent.glob(f"{glob.escape(place.name)}????????"):
            if _is_folder(found):
                yield found


def _reported(folder: Path) -> set[str] | None:
    """Names that the report in `folder` lists and that are named as ours; None without a report of
    ours. No path is followed.
    """
    try:
        status = (folder / REPORT).stat()
        if not stat.S_ISREG(status.st_mode) or status.st_size > _MOST_REPORTED:
            return None
        return listed(json.loads((folder / REPORT).read_text(encoding="utf-8")))
    except (FileNotFoundError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None


def listed(report: Mapping[str, Any]) -> set[str]:
    """Names that a `report` lists and that are named as ours.

    Raises LookupError, TypeError or AttributeError for what is no report.
    """
    return {name for name in _texts([*report["files"].values()]) if is_result_file(name)}


def _texts(value: object) -> Iterator[str]:
    """Every text in lists of lists: a map's files, or its mixes of files and weights."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list):
        for each in value:
            yield from _texts(each)


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def _is_same(one: Path, other: Path) -> bool:
    return os.path.lexists(other) and os.path.samestat(one.lstat(), other.lstat())


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _owners(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_uid, status.st_gid
