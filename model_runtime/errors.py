"""What can go wrong through no fault of the program, each kind with a sentence and a way out."""

from __future__ import annotations

__all__ = (
    "Cancelled",
    "InputError",
    "ModelFileError",
    "OutputError",
    "TvbrdfError",
    "UsageError",
)


class TvbrdfError(Exception):
    """A failure that the user can do something about.

    `message` is one sentence saying what is wrong, `hint` one saying what to do; `code` names the
    kind for programs (it travels in the worker's `error` replies).
    """

    code = "error"

    def __init__(self, message: str, hint: str = "") -> None:
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
        super().__init__("Cancelled; the earlier result is untouched.")
