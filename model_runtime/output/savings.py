"""What a run did not model or write because nobody would see it, as sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ("savings",)


def savings(
    *,
    texels: int,
    modeled: int,
    interval: int,
    files: Mapping[str, Sequence[str | Sequence[Sequence[Any]]]],
    coefficients: int | None = None,
    not_live: bool = False,
) -> list[str]:
    """A sentence each on the texels that were modeled, on what stands for frames, on frames that
    are only interpolated and on maps that lack frames.

    Every `interval`-th frame was aged; `files` are those of `aged.json`: per map and frame its
    file, or its mix of files. `coefficients` of a texel stand for all frames where that is not
    None; `not_live` where none could.
    """
    sentences = [_modeled(modeled, texels)]
    if coefficients is not None:
        return [*sentences, _live(coefficients)]
    if not_live:
        sentences.append("Wrote frames: no few coefficients a texel are near enough to them.")
    if interval > 1:
        sentences.append(f"Aged one frame in {interval}; those between are interpolated.")
    by_count: dict[tuple[int, int], list[str]] = {}
    for name, frames in files.items():
        stored = {
            file
            for mix in frames
            for file in ([mix] if isinstance(mix, str) else [part[0] for part in mix])
        }
        by_count.setdefault((len(stored), len(frames)), []).append(name.replace("_", " "))
    for (stored, frames), names in by_count.items():
        listed = " and ".join(filter(None, (", ".join(names[:-1]), names[-1]))).capitalize()
        if stored == frames:
            continue
        if stored == 1:
            sentences.append(f"{listed} {'do' if len(names) > 1 else 'does'} not change.")
        else:
            each = " each" if len(names) > 1 else ""
            sentences.append(f"{listed}: wrote {stored} of {frames} frames{each}.")
    return sentences


def _modeled(modeled: int, texels: int) -> str:
    if texels == 1:
        return "Modeled one texel: the material is the same all over."
    if modeled >= texels:
        return f"Modeled every one of {texels:,} texels."
    return f"Modeled {modeled:,} texel{'s' * (modeled > 1)} for all {texels:,}."


def _live(coefficients: int) -> str:
    if coefficients == 0:
        return "The shader does the aging, from curves that all texels share."
    plural = "s" * (coefficients > 1)
    return f"The shader does the aging, from curves and {coefficients} number{plural} a texel."
