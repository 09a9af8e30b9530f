"""Signals that end a process, as an exception, so that what it has begun is tidied up."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

__all__ = ("EndedBySignal", "EndingSignals", "undisturbed")

_ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


class EndedBySignal(BaseException):
    """Somebody wants the process to end; `exit_code` is 128 and the signal's number."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.exit_code = 128 + number


class EndingSignals:
    """Raises EndedBySignal in the main thread at the first of these signals, `received`.

    Those after it are ignored: they would only disturb the tidying up. So is SIGHUP where it was
    ignored before, by nohup. SIGINT never is: a shell's script lets its background jobs ignore
    Ctrl-C, and they would outlive it.
    """

    def __init__(self) -> None:
        self.received: int | None = None

    def heed(self) -> None:
        for number in _ENDING:
            if number == signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._end)

    def ignore(self) -> None:
        for number in _ENDING:
            signal.signal(number, signal.SIG_IGN)

    def _end(self, number: int, _frame: FrameType | None) -> NoReturn:
        self.ignore()
        self.received = number
        raise EndedBySignal(number)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Signals that would raise something within the block do so at its end."""
    if threading.current_thread() is not threading.main_thread():
        yield  # no handler ever runs in it
        return
    waiting: list[int] = []
    before = {number: signal.getsignal(number) for number in _ENDING}
    handled = [number for number, handler in before.items() if callable(handler)]
    for number in handled:
        signal.signal(number, lambda number, _: waiting.append(number))
    try:
        yield
    finally:
        for number in handled:
            signal.signal(number, before[number])
        for number in waiting:
            signal.raise_signal(number)
