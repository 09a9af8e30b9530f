"""What users are told of errors, and the log of those that nobody foresaw."""

from __future__ import annotations

import contextlib
import platform
import sys
import tempfile
import time
import traceback
from pathlib import Path

import bpy

from ..model_runtime import __version__
from ..model_runtime.errors import Cancelled, TvbrdfError, reason, shown
from . import preferences

__all__ = ("is_cancel", "said_of", "tell")

LOG = "error.log"
LONGEST_LOG = 1 << 20

# What was written last: a panel may fail each time that it is drawn.
_last_details = ""


def said_of(error: BaseException) -> str:
    """The sentences that tell the user of `error`.

    Where nobody foresaw it, it is written to the log, and they say where that is.
    """
    if isinstance(error, KeyboardInterrupt):
        return str(Cancelled())
    if isinstance(error, TvbrdfError):
        said, details = str(error), getattr(error, "details", "")
    else:
        said = f"This should not happen ({type(error).__name__}: {reason(error)})."
        details = "".join(traceback.format_exception(error))
    return f"{said} {_logged(details)}" if details else said


def is_cancel(error: BaseException) -> bool:
    """Whether `error` is what the user asked for."""
    return isinstance(error, KeyboardInterrupt) or getattr(error, "code", "") == Cancelled.code


def tell(text: str, *, of_error: bool = False) -> None:
    """Print `text`; where nobody listens any more, the work goes on."""
    with contextlib.suppress(OSError, ValueError):
        print(text, file=sys.stderr if of_error else sys.stdout, flush=True)


def _logged(details: str) -> str:
    """Write `details` to the log; the sentence that says where it is."""
    global _last_details
    path = _path()
    if details != _last_details:
        try:
            keep = path.is_file() and path.stat().st_size < LONGEST_LOG
            with path.open("a" if keep else "w", encoding="utf-8", errors="replace") as log:
                log.write(f"{_circumstances()}\n{details.rstrip()}\n\n")
        except OSError:
            tell(details, of_error=True)
            return "Please report it, with what the system console shows."
        _last_details = details
    return f"Please report it and send the file {shown(path)}."


def _path() -> Path:
    return preferences.user_file(LOG) or Path(tempfile.gettempdir()) / f"tvbrdf-{LOG}"


def _circumstances() -> str:
    """When and where it happened."""
    now = time.strftime("%Y-%m-%d %H:%M:%S")
    return f"{now}  tvbrdf {__version__}, Blender {bpy.app.version_string}, {platform.platform()}"
