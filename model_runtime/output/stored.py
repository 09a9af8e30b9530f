"""Writing a result: staged first, moved into its folder when it is complete."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Collection
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

from ..contract import REPORT
from ..errors import OutputError, reason, shown
from ..images import Compression, Depth, write_exr, write_png
from ..maps import Bytes, Halves, Pixels
from ..signals import undisturbed
from .commit import commit, require_free
from .staging import found, staging

__all__ = ("StagedResult", "check_space")

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
    """A context that collects images and a report for `folder`, which is looked at on entry.

    `commit` moves them in, replacing an earlier result of ours and nothing else; leaving the
    context without it removes what was staged and leaves the earlier result as it was.
    """

    def __init__(self, folder: Path, *, compression: Compression = "zip") -> None:
        self.folder = folder
        self._compression: Compression = compression
        self._pending: list[tuple[str, Future[int]]] = []
        self._sizes: dict[str, int] = {}

    def __enter__(self) -> StagedResult:
        with ExitStack() as leaving:
            try:
                self.folder = found(self.folder)
                self._staging = leaving.enter_context(staging(self.folder))
            except (OSError, ValueError) as error:
                raise self._unwritable(error) from error
            self._pool = ThreadPoolExecutor(_WRITERS)
            leaving.callback(self._pool.shutdown, cancel_futures=True)
            self._leaving = leaving.pop_all()
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
        """Queue `pixels` ([H, W] or [H, W, 3]) to be written as `name`, an EXR file; errors show
        here or later.
        """
        how = {"compression": compression or self._compression, "depth": depth}
        self._queue(name, partial(write_exr, pixels=pixels, **how))

    def write_bytes(self, name: str, pixels: Bytes) -> None:
        """Likewise [H, W, 3 or 4] as a PNG file."""
        self._queue(name, partial(write_png, pixels=pixels))

    def write_file(self, name: str, content: bytes) -> None:
        """Likewise a file as it is."""
        self._queue(name, lambda path: path.write_bytes(content))

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

    def _queue(self, name: str, write: Callable[[Path], object]) -> None:
        def written() -> int:
            """The size of the file in bytes."""
            path = self._staging / name
            write(path)
            return path.stat().st_size

        self._settle(_QUEUED)
        self._pending.append((name, self._pool.submit(written)))

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
                now = path.stat().st_size
            except OSError as error:
                what = f"cannot be found again ({reason(error)})"
            else:
                if now == size:
                    continue
                what = f"has {now} bytes instead of {size}"
            raise OutputError(
                f"{shown(path)} was written and {what}: another program has changed it.",
                "Run it again, and keep other programs out of that folder.",
            )

    def _unwritable(self, error: OSError | ValueError) -> OutputError:
        why = reason(error)
        if isinstance(error, OSError) and error.filename:
            path = Path(os.fsdecode(error.filename))
            if path.parent == self.folder and not path.name.startswith("."):
                why = f"{path.name}: {why}"
        return OutputError(
            f"The folder {shown(self.folder)} cannot be written ({why}).",
            "Choose a folder that can be written, with space left.",
        )
