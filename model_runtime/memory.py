"""How much memory a process has held, and what to say where it runs out, in whichever library."""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import OutOfMemoryError, TvbrdfError

__all__ = ("check_limits", "memory_in_words", "peak_rss_mb", "ran_out_of_memory")

_MESSAGE = "There is not enough memory."
_OUT_OF_MEMORY = re.compile(
    "not enough memory|out of memory|cannot allocate memory|failed to map segment|bad_alloc"
    "|can't start new thread|unable to allocate|defaultcpuallocator",
    re.IGNORECASE,
)
_LEAST_ADDRESSES = 600 << 20
_LEAST_DATA = 150 << 20


def ran_out_of_memory(error: BaseException | None) -> bool:
    """Whether `error`, or what it was raised from, says so in any library's way."""
    while error is not None:
        if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM:
            return True
        if not isinstance(error, TvbrdfError) and _OUT_OF_MEMORY.search(str(error)):
            return True
        error = error.__cause__ or error.__context__
    return False


@contextmanager
def memory_in_words(way_out: str) -> Iterator[None]:
    """Where what is done inside runs out of memory, OutOfMemoryError says so, with `way_out`."""
    try:
        yield
    except Exception as error:
        if isinstance(error, TvbrdfError) or not ran_out_of_memory(error):
            raise
        raise OutOfMemoryError(_MESSAGE, way_out) from error


def check_limits() -> None:
    """Raise OutOfMemoryError under limits (`ulimit -v`, `-d`) that torch cannot be loaded in: it
    would abort the process, or never end it.
    """
    try:
        import resource
    except ImportError:  # Windows
        return
    limits = {resource.RLIMIT_AS: _LEAST_ADDRESSES, resource.RLIMIT_DATA: _LEAST_DATA}
    for limit, least in limits.items():
        allowed, _ = resource.getrlimit(limit)
        if 0 <= allowed < least:
            raise OutOfMemoryError(_MESSAGE, "Allow this process more.")


def peak_rss_mb() -> float | None:
    """The most memory this process has held so far, in MB; None where the system does not tell."""
    # Linux counts in ru_maxrss what the parent held when it started this process.
    status = Path("/proc/self/status")
    if status.exists():
        held = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return round(int(held["VmHWM"].split()[0]) / (1 << 10), 1)
    try:
        import resource
    except ImportError:  # Windows
        return None
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 20), 1)
