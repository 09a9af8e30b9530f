"""Writing a result: staged beside its folder, moved in when it is complete."""

from __future__ import annotations

import glob
import json
import re
import shutil
import tempfile
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Any

from .errors import OutputError
from .images import Compression, Depth, write_exr
from .maps import Halves, Pixels

__all__ = ("REPORT", "StagedResult", "check_space")

REPORT = "aged.json"

_OURS = re.compile(r"[a-z_]+_[0-9]{4,}\.exr|coefficients_[0-9]+\.exr|timing\.exr|curves\.exr")
_ABANDONED_SECONDS = 24 * 3600
# OpenEXR holds the interpreter while it codes: one thread waits for the disk, and no more maps are
# held back for it than half a frame has.
_WRITERS = 1
_QUEUED = 2


def check_space(folder: Path, needed: int) -> None:
    """Raise OutputError unless the disk of `folder` (which may not exist yet) has `needed`
    bytes.
    """
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    free = shutil.disk_usage(existing).free
    if needed > free:
        raise OutputError(
            f"The result may need {needed / 1e6:,.0f} MB; {existing} has {free / 1e6:,.0f} left.",
            "Free some space, choose another folder, a smaller size or fewer frames.",
        )


class StagedResult:
    """A context that collects EXR files and a report beside `folder`.

    `commit` moves them in, replacing an earlier result of ours and nothing else; leaving the
    context without it removes what was staged and leaves the earlier result as it was.
    """

    def __init__(self, folder: Path, *, compression: Compression = "zip") -> None:
        self.folder = folder.absolute()
        self._compression: Compression = compression
        self._pending: list[Future[None]] = []

    def __enter__(self) -> StagedResult:
        try:
            if self.folder.exists() and not self.folder.is_dir():
                raise OutputError(
                    f"{self.folder} is a file, not a folder.", "Choose another output folder."
                )
            self.folder.parent.mkdir(parents=True, exist_ok=True)
            self._sweep()
            staging = tempfile.mkdtemp(prefix=self._prefix, dir=self.folder.parent)
        except OSError as error:
            raise self._unwritable(error) from error
        self._staging = Path(staging)
        self._pool = ThreadPoolExecutor(_WRITERS)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._pool.shutdown(cancel_futures=True)
        shutil.rmtree(self._staging, ignore_errors=True)

    def write(self, name: str, pixels: Pixels | Halves, *, depth: Depth = "half") -> None:
        """Queue `pixels` ([H, W] or [H, W, 3]) to be written as `name`; errors show here or
        later.
        """
        self._settle(_QUEUED)
        path = self._staging / name
        self._pending.append(
            self._pool.submit(write_exr, path, pixels, compression=self._compression, depth=depth)
        )

    def finish(self) -> None:
        """Wait until everything queued is written."""
        self._settle(0)

    def commit(self, report: dict[str, Any]) -> None:
        """Wait for all files, then move them and `report` (aged.json) into the folder."""
        self.finish()
        try:
            staged = self._staging / REPORT
            staged.write_text(json.dumps(report, indent=1), encoding="utf-8")
            self.folder.mkdir(exist_ok=True)
            before = self._earlier_files()
            names = sorted(path.name for path in self._staging.iterdir() if path.name != REPORT)
            self._check_nothing_is_in_the_way([*names, REPORT])
            for name in names:
                (self._staging / name).replace(self.folder / name)
            for name in before - set(names):
                (self.folder / name).unlink(missing_ok=True)
            staged.replace(self.folder / REPORT)
        except OSError as error:
            raise self._unwritable(error) from error

    @property
    def _prefix(self) -> str:
        return f".{self.folder.name}.partial-"

    def _check_nothing_is_in_the_way(self, names: list[str]) -> None:
        """A folder is no earlier result of ours; found half way it would leave two halves."""
        for name in names:
            if (self.folder / name).is_dir():
                raise OutputError(
                    f"{self.folder / name} is a folder where a file is to be written.",
                    "Move it away, or choose another output folder.",
                )

    def _settle(self, allowed: int) -> None:
        while len(self._pending) > allowed:
            self._pending.pop(0).result()

    def _sweep(self) -> None:
        """Remove what a worker that was killed a day or longer ago left behind."""
        for path in self.folder.parent.glob(f"{glob.escape(self._prefix)}*"):
            if path.is_dir() and time.time() - path.stat().st_mtime > _ABANDONED_SECONDS:
                shutil.rmtree(path, ignore_errors=True)

    def _earlier_files(self) -> set[str]:
        """Names of files that the report in the folder says are ours and that are named as ours; no
        path is followed.
        """
        try:
            earlier = json.loads((self.folder / REPORT).read_text(encoding="utf-8"))
            listed = [
                entry
                for files in earlier["files"].values()
                for entry in ([files] if isinstance(files, str) else files)
            ]
            names = {
                name
                for entry in listed
                for name in ([entry] if isinstance(entry, str) else [part[0] for part in entry])
            }
        except (
            OSError,
            ValueError,
            RecursionError,
            KeyError,
            TypeError,
            AttributeError,
            IndexError,
        ):
            return set()
        ours = {name for name in names if isinstance(name, str) and _OURS.fullmatch(name)}
        return {name for name in ours if not (self.folder / name).is_dir()}

    def _unwritable(self, error: OSError) -> OutputError:
        return OutputError(
            f"The folder {self.folder} cannot be written ({error.strerror}).",
            "Choose a folder that can be written, with space left.",
        )
