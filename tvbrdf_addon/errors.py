"""What can go wrong in the add-on, beside the kinds that the worker reports."""

from __future__ import annotations

from ..model_runtime.errors import TvbrdfError

__all__ = ("MaterialError", "RunEndedError", "SettingsError", "WorkerError")


class MaterialError(TvbrdfError):
    """A material that cannot be read, or a result that cannot be bound to it."""

    code = "material"


class SettingsError(TvbrdfError):
    """A setting of the panel, the preferences or the command that cannot be used."""

    code = "settings"


class RunEndedError(TvbrdfError):
    """A run that something else ended: its material was deleted, a file was loaded, an undo."""

    code = "ended"


class WorkerError(TvbrdfError):
    """A worker that does not start, died, speaks another protocol, or reported an error.

    `code` is the worker's own where it reported one (`input`, `cancelled`, ...).  `details` is for
    whoever mends it: the traceback of an error that nobody foresaw, or what it said as it died.
    """

    def __init__(
        self, message: str, hint: str = "", *, code: str = "worker", details: str = ""
    ) -> None:
        super().__init__(message, hint)
        self.code = code
        self.details = details
