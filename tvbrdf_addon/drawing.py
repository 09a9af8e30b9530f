"""What panels are drawn with: text over several lines, and words in the place of what fails."""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Callable
from typing import Literal, TypeAlias

import bpy

from ..model_runtime.errors import shown
from .log import said_of

__all__ = ("Icon", "guarded", "lines", "paragraph")

# Average width of a letter of the interface font, in unscaled pixels, and what icons and borders
# take away from a line.
LETTER_PIXELS = 6.4
MARGIN_PIXELS = 55
LONGEST_TEXT = 2000

Draw = Callable[[bpy.types.UILayout, bpy.types.Context], None]
Icon: TypeAlias = Literal["NONE", "CAMERA_DATA", "DOT", "ERROR", "INFO", "PLAY", "TIME"]


def paragraph(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    text: str,
    icon: Icon = "NONE",
    *,
    share: float = 1.0,
) -> None:
    """`text` over as many lines as that share of the region needs."""
    pixels = (context.region.width / context.preferences.system.ui_scale - MARGIN_PIXELS) * share
    lines(layout, text, max(int(pixels / LETTER_PIXELS), 12), icon)


def lines(layout: bpy.types.UILayout, text: str, letters: int, icon: Icon = "NONE") -> None:
    """`text` over lines of at most so many `letters`: Blender's labels do not wrap."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(textwrap.wrap(shown(text, most=LONGEST_TEXT), letters)):
        if icon == "NONE":
            column.label(text=line)
        else:
            column.label(text=line, icon=icon if number == 0 else "BLANK1")


def guarded(draw: Draw) -> Draw:
    """`draw`, which says so in the panel where it fails."""

    @functools.wraps(draw)
    def drawn(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        try:
            draw(layout, context)
        except Exception as error:
            paragraph(layout, context, said_of(error), "ERROR")

    return drawn
