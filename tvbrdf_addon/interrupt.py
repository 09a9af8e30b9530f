"""Ctrl-C and other signals that ask a command to end.  Imports no bpy."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Any

__all__ = ("Interrupts",)


class Interrupts:
    """A context in which the first of them does not end the process, but is `caught`.

    A second of the same kind ends it at once.  What the shell told us to ignore stays ignored.
    """

    def __init__(self) -> None:
        self.caught: int | None = None
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interrupts:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            if number is not None and signal.getsignal(number) != signal.SIG_IGN:
                self._before[number] = signal.signal(number, self._catch)
        return self

    def __exit__(self, *_error: object) -> None:
        for number, handler in self._before.items():
            # None stands for one of Blender's own, which Python cannot set again.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

    @property
    def exit_code(self) -> int:
        """The shell's code for a command that was ended so; 0 where none was caught."""
        return 0 if self.caught is None else 128 + self.caught

    def _catch(self, number: int, _frame: FrameType | None) -> None:
        self.caught = number
        signal.signal(number, signal.SIG_DFL)
