"""Text from files and other programs, made fit to be shown.  Imports no bpy."""

from __future__ import annotations

import unicodedata

__all__ = ("is_plain", "plain")

LONGEST = 1000

# Control characters, a terminal's among them; halves of characters, which nothing can encode; line
# and paragraph separators.
_UNFIT = frozenset({"Cc", "Cs", "Zl", "Zp"})
# What turns the direction of the text that follows.
_TURNING = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")


def plain(text: object, *, longest: int = LONGEST) -> str:
    """`text` on one line, of no more than `longest` characters."""
    shown = str(text)[: longest + 1]
    shown = "".join("�" if _is_unfit(letter) else letter for letter in " ".join(shown.split()))
    return shown if len(shown) <= longest else shown[: longest - 1] + "…"


def is_plain(text: str, *, longest: int = LONGEST) -> bool:
    """Whether `text` can be shown as it is; it may have several lines."""
    return len(text) <= longest and not any(map(_is_unfit, " ".join(text.split())))


def _is_unfit(letter: str) -> bool:
    return letter in _TURNING or unicodedata.category(letter) in _UNFIT
