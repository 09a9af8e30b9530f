"""Writing a result: staged first, moved into its folder when it is complete."""

from __future__ import annotations

import errno
import json
import os
import secrets
import shutil
import stat
from collections.abc import Collection
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from .commit import REPORT, clear, commit, places, recover, require_free
from .errors import OutputError
from .holding import hold, let_go
from .images import Compression, Depth, write_exr
from .maps import Halves, Pixels
from .signals import undisturbed

__all__ = ("REPORT", "StagedResult", "check_space")

# OpenEXR holds the interpreter while it codes: one thread waits for the disk, and no more maps are
# held back for it than half a frame has.
_WRITERS = 1
_QUEUED = 2


def check_space(folder: Path, needed: int, files: int = 0) -> None:
    """Raise OutputError unless the disk of `folder` (which may not exist yet) has `needed` bytes
    and room for so many `files`, where it counts them.
    """
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    free = shutil.disk_usage(existing).free
    if needed > free:
        raise OutputError(
            f"The result may need {needed / 1e6:,.0f} MB; {existing} has {free / 1e6:,.0f} left.",
            "Free some space, choose another folder, a smaller size or fewer frames.",
        )
    if hasattr(os, "statvfs"):
        disk = os.statvfs(existing)
        if disk.f_files > 0 and disk.f_favail < files:
            raise OutputError(
                f"The result may have {files} files; {existing} has room for {disk.f_favail}.",
                "Remove some files, choose another folder or fewer frames.",
            )


class StagedResult:
    """A context that collects EXR files and a report for `folder`, which is looked at on entry.

    `commit` moves them in, replacing an earlier result of ours and nothing else; leaving the
    context without it removes what was staged and leaves the earlier result as it was.
    """

    def __init__(self, folder: Path, *, compression: Compression = "zip") -> None:
        self.folder = folder
        self._compression: Compression = compression
        self._pending: list[tuple[str, Future[int]]] = []
        self._sizes: dict[str, int] = {}
        self._leaving = ExitStack()

    def __enter__(self) -> StagedResult:
        try:
            given, self.folder = self.folder, Path(os.path.realpath(self.folder))
            new = self._is_new(given)
            recover(self.folder)
            with undisturbed():
                self._stage(new)
        except BaseException as error:
            self._leaving.close()
            if isinstance(error, OSError | ValueError):
                raise self._unwritable(error) from error
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with undisturbed():
            self._leaving.close()

    def require_free(self, names: Collection[str]) -> None:
        """Raise OutputError where a file of `names` would replace one that is not ours."""
        require_free(self.folder, names)

    def write(
        self,
        name: str,
        pixels: Pixels | Halves,
        *,
        compression: Compression | None = None,
        depth: Depth = "half",
    ) -> None:
        """Queue `pixels` ([H, W] or [H, W, 3]) to be written as `name`; errors show here or
        later.
        """
        self._settle(_QUEUED)
        how = compression or self._compression, depth
        self._pending.append((name, self._pool.submit(self._write, name, pixels, *how)))

    def finish(self) -> None:
        """Wait until everything queued is written."""
        self._settle(0)

    def commit(self, report: dict[str, Any]) -> None:
        """Wait for all files, then move them and `report` (aged.json), which lists them, into the
        folder.
        """
        self.finish()
        self._require_whole()
        try:
            (self._staging / REPORT).write_text(json.dumps(report, indent=1), encoding="utf-8")
            commit(self._staging, self.folder, sorted(self._sizes))
        except OSError as error:
            raise self._unwritable(error) from error

    def _is_new(self, given: Path) -> bool:
        """Whether the folder is not there yet."""
        try:
            mode = self.folder.stat().st_mode
        except FileNotFoundError:
            if given.is_symlink():
                raise OutputError(
                    f"{given} is a link that leads nowhere.", "Choose another output folder."
                ) from None
            return True
        if not stat.S_ISDIR(mode):
            raise OutputError(
                f"{self.folder} is a file, not a folder.", "Choose another output folder."
            )
        return False

    def _stage(self, new: bool) -> None:
        """Make a staging folder from where files can be moved into the folder.

        That is beside it, so that the two can change places; else, as where the folder is a disk of
        its own, or its parent cannot be written to, or there is no room for a longer name, within.
        """
        beside, within = places(self.folder, secrets.token_hex(4))
        try:
            if new:
                self._make(self.folder.parent)
                self._leaving.callback(_remove_empty, self.folder)
            self._staging = beside
            beside.mkdir()
            if not new:
                beside.rename(within)
                within.rename(beside)
        except OSError as error:
            if new and error.errno != errno.ENAMETOOLONG:
                raise
            _remove_empty(beside)
            self._staging = within
            within.parent.mkdir(exist_ok=True)
            within.mkdir(exist_ok=True)
        self._leaving.callback(clear, self._staging)
        with suppress(OSError):  # a file system without locks
            self._leaving.callback(let_go, self._staging, hold(self._staging))
        self._pool = ThreadPoolExecutor(_WRITERS)
        self._leaving.callback(self._pool.shutdown, cancel_futures=True)

    def _make(self, folder: Path) -> None:
        missing = [each for each in (folder, *folder.parents) if not each.exists()]
        for each in reversed(missing):
            each.mkdir(exist_ok=True)
            self._leaving.callback(_remove_empty, each)

    def _write(
        self, name: str, pixels: Pixels | Halves, compression: Compression, depth: Depth
    ) -> int:
        """Write an image; its size in bytes."""
        path = self._staging / name
        write_exr(path, pixels, compression=compression, depth=depth)
        return path.stat().st_size

    def _settle(self, allowed: int) -> None:
        while len(self._pending) > allowed:
            name, written = self._pending.pop(0)
            try:
                self._sizes[name] = written.result()
            except OSError as error:
                raise self._unwritable(error) from error

    def _require_whole(self) -> None:
        """Raise OutputError where a staged file is no longer what was written."""
        for name, size in self._sizes.items():
            path = self._staging / name
            try:
                found = path.stat().st_size
            except OSError as error:
                reason = f"cannot be found again ({error.strerror})"
            else:
                if found == size:
                    continue
                reason = f"has {found} bytes instead of {size}"
            raise OutputError(
                f"{path} was written and {reason}: another program has changed it.",
                "Run it again, and keep other programs out of that folder.",
            )

    def _unwritable(self, error: OSError | ValueError) -> OutputError:
        reason = error
        if isinstance(error, OSError):
            reason = error.strerror
            if error.filename and Path(error.filename).parent == self.folder:
                reason = f"{Path(error.filename).name}: {reason}"
        return OutputError(
            f"The folder {self.folder} cannot be written ({reason}).",
            "Choose a folder that can be written, with space left.",
        )


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):  # it is not there, or something lies in it: the result, as a rule
        folder.rmdir()
