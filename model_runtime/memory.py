"""Memory that runs out, in words, whichever library it was that ran out."""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator
from contextlib import contextmanager

from .errors import OutOfMemoryError, TvbrdfError

__all__ = ("check_limits", "memory_in_words", "ran_out_of_memory")

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
