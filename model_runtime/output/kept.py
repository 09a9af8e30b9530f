"""Results that are kept for whoever asks for the very same again, up to so many bytes of a disk.

Each is one file, an archive without compression that holds the result's files and its report, named
by what it was made from. It appears whole or not at all; its checksums tell damage. Of more than
fits those go that were not used for longest. Any number of processes may share the folder; what is
not named as ours in it is not touched. Standard library only.
"""

from __future__ import annotations

import json
import re
import shutil
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..atomic import replaced
from ..contract import REPORT
from ..errors import OutputError
from .commit import listed
from .holding import held, hold, let_go

__all__ = ("Kept",)

_LARGEST = 0.25  # of all bytes, that one result may have
_PAUSE = 0.1  # seconds between two looks at another process that makes the same
_LEFT_BEHIND = 3600.0  # seconds after which nobody writes to a file any more
_ARCHIVE = re.compile(r"[0-9a-f]{64}\.zip")
_PARTIAL = re.compile(r"\.[0-9a-f]{64}\.zip\.\d+\.partial")
_MAKING = re.compile(r"[0-9a-f]{64}\.making")
# Whatever a file may hold in the place of an archive of ours.
_DAMAGED = (OSError, EOFError, ValueError, LookupError, TypeError, RuntimeError, AttributeError)


@dataclass(frozen=True)
class Kept:
    """The results kept in `folder`, which need not exist, in at most so many `bytes`.

    A key is 64 hexadecimal digits: the same for what would be the same result, and for that alone.
    """

    folder: Path
    bytes: float

    def has(self, key: str) -> bool:
        return self._archive(key).is_file()

    def take(self, key: str, put: Callable[[str, bytes], None]) -> dict[str, Any] | None:
        """Hand the name and content of each file of a result to `put`; its report.

        None where none is kept; one that is damaged is dropped, when some files may have been
        handed over already.
        """
        path = self._archive(key)
        try:
            with zipfile.ZipFile(path) as archive:
                report = _checked(archive, path.stat().st_size)
                for name in sorted(listed(report)):
                    put(name, archive.read(name))
        except FileNotFoundError:
            return None
        except (*_DAMAGED, zipfile.BadZipFile):
            _drop(path)
            return None
        with suppress(OSError):  # it is somebody else's
            path.touch()
        return report

    def keep(self, key: str, folder: Path, report: Mapping[str, Any]) -> None:
        """Keep the result in `folder` if it is still the one of this `report`.

        What is too large for its share, or cannot be written, is not kept: no run needs it.
        """
        names = sorted(listed(report))
        with suppress(OSError, OutputError), held(folder):
            size = sum((folder / name).stat().st_size for name in names)
            whole = json.loads(json.dumps(report))
            there = json.loads((folder / REPORT).read_text(encoding="utf-8"))
            if size > self.bytes * _LARGEST or there != whole or not self._has_room(size):
                return
            with (
                replaced(self._archive(key)) as beside,
                zipfile.ZipFile(beside, "w", strict_timestamps=False) as archive,
            ):
                for name in (*names, REPORT):
                    archive.write(folder / name, name)
        self._remove_oldest()

    def _has_room(self, size: int) -> bool:
        """Whether the disk has more than a result of this `size` and all that may be kept."""
        self.folder.mkdir(parents=True, exist_ok=True)
        return shutil.disk_usage(self.folder).free > size + self.bytes - self.size()

    @contextmanager
    def alone(self, key: str, wait: Callable[[], None]) -> Iterator[None]:
        """Let no other process into such a block with this `key` meanwhile, as long as this one
        lives; `wait` is called now and then until it is let in, and may raise.

        Where there are no locks, or nothing can be written, all are let in.
        """
        place = self.folder / f"{key}.making"
        try:
            mine = _held_when_free(place, wait)
        except OSError:
            yield
            return
        try:
            yield
        finally:
            _leave(place, mine)

    def size(self) -> int:
        """How many bytes are kept."""
        return sum(size for _, size, _ in self._archives())

    def clear(self) -> None:
        """Keep nothing of what was kept until now."""
        for _, _, path in self._archives():
            _drop(path)
        self._tidy()

    def _archive(self, key: str) -> Path:
        return self.folder / f"{key}.zip"

    def _archives(self) -> list[tuple[float, int, Path]]:
        """When each was last used, its size, and its file."""
        found = []
        for path in self._named(_ARCHIVE):
            with suppress(OSError):  # another process has just removed it
                status = path.stat()
                found.append((status.st_mtime, status.st_size, path))
        return sorted(found)

    def _named(self, pattern: re.Pattern[str]) -> list[Path]:
        try:
            return [path for path in self.folder.iterdir() if pattern.fullmatch(path.name)]
        except OSError:
            return []

    def _remove_oldest(self) -> None:
        archives = self._archives()
        left = sum(size for _, size, _ in archives)
        for _, size, path in archives:
            if left <= self.bytes:
                break
            _drop(path)
            left -= size
        self._tidy()

    def _tidy(self) -> None:
        """Remove what processes that were killed have left."""
        for path in self._named(_PARTIAL):
            with suppress(OSError):
                if time.time() - path.stat().st_mtime > _LEFT_BEHIND:
                    path.unlink()
        for place in self._named(_MAKING):
            with suppress(OSError):  # who holds it lives
                _leave(place, hold(place))


def _checked(archive: zipfile.ZipFile, size: int) -> dict[str, Any]:
    """The report in an archive file of this `size`; ValueError where that is none of ours."""
    infos = archive.infolist()
    if sum(each.file_size for each in infos) > size:
        raise ValueError("it holds more than it has room for")
    report = json.loads(archive.read(REPORT))
    if sorted(each.filename for each in infos) != sorted({REPORT, *listed(report)}):
        raise ValueError("its report lists other files")
    return report


def _held_when_free(place: Path, wait: Callable[[], None]) -> int:
    while True:
        place.mkdir(parents=True, exist_ok=True)
        try:
            return hold(place)
        except BlockingIOError:
            wait()
            time.sleep(_PAUSE)
        except FileNotFoundError:  # who held it has just removed it
            continue


def _leave(place: Path, mine: int) -> None:
    with suppress(OSError):  # Windows, where what holds it lies in it
        place.rmdir()
    let_go(place, mine)
    with suppress(OSError):  # gone, but on Windows
        place.rmdir()


def _drop(path: Path) -> None:
    with suppress(OSError):  # another process has, or reads it on Windows
        path.unlink()
