"""What can go wrong through no fault of the program, each kind with a sentence and a way out."""

from __future__ import annotations

import re
from pathlib import Path

__all__ = (
    "Cancelled",
    "InputError",
    "ModelFileError",
    "OutOfMemoryError",
    "OutputError",
    "TvbrdfError",
    "UsageError",
    "is_plain",
    "reason",
    "shown",
)

# Control characters, escape codes among them; marks that turn the writing direction; halves of
# surrogate pairs, which no file can be written with.
_NOT_PLAIN = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
_LONGEST_QUOTE = 80
_LONGEST_PATH = 240
_LONGEST_SENTENCE = 600


def is_plain(text: str) -> bool:
    """Whether `text` can be shown anywhere as it is: no escape codes, no lone surrogates."""
    return _NOT_PLAIN.search(text) is None


def shown(foreign: object, *, most: int | None = None) -> str:
    """What a file, a path or a library says, fit for a sentence of ours.

    What is not plain is escaped, and of more than `most` characters (80; of a path, which is to be
    found again, 240) the middle is left out.
    """
    if most is None:
        most = _LONGEST_PATH if isinstance(foreign, Path) else _LONGEST_QUOTE
    text = str(foreign)
    if len(text) > most:
        text = f"{text[: most // 2 - 2]}...{text[-(most // 2 - 2) :]}"
    return _NOT_PLAIN.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def reason(error: BaseException) -> str:
    """Why `error` was raised, without the path that an OSError adds: our sentence names it."""
    return shown(getattr(error, "strerror", None) or error)


class TvbrdfError(Exception):
    """A failure that the user can do something about.

    `message` is one sentence saying what is wrong, `hint` one saying what to do; `code` names the
    kind for programs (it travels in the worker's `error` replies). Whatever they quote, they are
    plain and not endless.
    """

    code = "error"

    def __init__(self, message: str, hint: str = "") -> None:
        message, hint = (shown(text, most=_LONGEST_SENTENCE) for text in (message, hint))
        super().__init__(f"{message} {hint}".strip())
        self.message = message
        self.hint = hint


class UsageError(TvbrdfError):
    """A setting that is out of range or contradicts another."""

    code = "usage"


class InputError(TvbrdfError):
    """A material, map or measurement that cannot be read or makes no sense."""

    code = "input"


class ModelFileError(TvbrdfError):
    """A model file that is missing, damaged, too new, or made for another encoder."""

    code = "model_file"


class OutputError(TvbrdfError):
    """A result that cannot be written."""

    code = "output"


class Cancelled(TvbrdfError):  # noqa: N818
    """The user asked for the run to end; nothing was changed."""

    code = "cancelled"

    def __init__(self) -> None:
        super().__init__("Canceled; the earlier result is untouched.")


class OutOfMemoryError(TvbrdfError):
    """The system has no more memory, or no more threads, to give."""

    code = "memory"
