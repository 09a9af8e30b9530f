"""Runs of `age` inside an evaluation."""

from __future__ import annotations

__all__ = ("Silent",)


class Silent:
    """A reporter of runs that nobody watches: what they say is in their report."""

    def progress(self, stage: str, fraction: float) -> None:
        pass

    def warning(self, message: str) -> None:
        pass

    def cancelled(self) -> bool:
        return False
