"""What the command prints as it goes on, for people and for the farms that read it."""

from __future__ import annotations

import time

from ..log import tell
from ..run import Run

__all__ = ("STYLES", "Progress")

PLAIN, OPENJD = "plain", "openjd"
STYLES = (PLAIN, OPENJD)
# A log that grows by more is no help.
_SECONDS = 1.0


class Progress:
    """Prints a line a second at most: how far a material is, and how far all of them are.

    In the style `openjd`, messages of Open Job Description instead; `quiet` prints neither.
    """

    def __init__(self, style: str, *, quiet: bool) -> None:
        self.materials = 1
        self.ended = 0
        self._openjd = style == OPENJD
        self._quiet = quiet
        self._said = -_SECONDS

    def note(self, sentence: str) -> None:
        """Print what is neither a warning nor the end."""
        if not self._quiet:
            tell(sentence)

    def of(self, run: Run) -> None:
        """Print how far `run` is, unless something was said just now."""
        self.say(run.plan.material_name, run.fraction, run.stage)

    def say(self, name: str, share: float, stage: str) -> None:
        """Print how far the material `name` is, unless something was said just now."""
        if self._quiet or time.monotonic() - self._said < _SECONDS:
            return
        self._said = time.monotonic()
        whole = (self.ended + share) / self.materials
        said = f"{name}: {share:.0%} {stage}"
        if self._openjd:
            tell(f"openjd_progress: {100 * whole:.1f}")
            tell(f"openjd_status: {said}")
        elif self.materials == 1:
            tell(said)
        else:
            tell(f"{said} ({self.ended + 1} of {self.materials}, {whole:.0%} of all)")
