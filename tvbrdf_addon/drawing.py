"""What panels are drawn with: text over several lines, and words in the place of what fails."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Literal, TypeAlias

import bpy

from ..model_runtime.errors import shown
from .log import said_of

__all__ = ("Icon", "guarded", "is_narrow", "lines", "paragraph", "wrapped")

# What borders and the sidebar's tabs take away from a region's width, and an icon from a line, in
# unscaled pixels.
BORDERS, ICON = 58, 26
NARROW = 230
LONGEST_TEXT = 2000

Draw = Callable[[bpy.types.UILayout, bpy.types.Context], None]
Icon: TypeAlias = Literal["NONE", "CAMERA_DATA", "DOT", "ERROR", "INFO", "PLAY", "TIME"]


def is_narrow(context: bpy.types.Context) -> bool:
    """Whether the region has no room for text beside a picture, or much beside a title."""
    return _width(context) < NARROW


def _width(context: bpy.types.Context) -> float:
    """The region's, in unscaled pixels."""
    return context.region.width / context.preferences.system.ui_scale


def paragraph(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    text: str,
    icon: Icon = "NONE",
    *,
    share: float = 1.0,
) -> None:
    """`text` over as many lines as that share of the region needs."""
    lines(layout, text, (_width(context) - BORDERS) * share - ICON, icon)


def lines(layout: bpy.types.UILayout, text: str, width: float, icon: Icon = "NONE") -> None:
    """`text` over lines of at most that `width`, in unscaled pixels: labels do not wrap."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(wrapped(shown(text, most=LONGEST_TEXT), width)):
        if icon == "NONE":
            column.label(text=line)
        else:
            column.label(text=line, icon=icon if number == 0 else "BLANK1")


def wrapped(text: str, width: float) -> list[str]:
    """`text` in lines as wide as Blender's interface draws them, a word at the least."""
    import blf  # only there once bpy is

    blf.size(0, bpy.context.preferences.ui_styles[0].widget.points)
    found: list[str] = []
    for word in text.split():
        longer = f"{found[-1]} {word}" if found else word
        if found and blf.dimensions(0, longer)[0] <= width:
            found[-1] = longer
        else:
            found.append(word)
    return found


def guarded(draw: Draw) -> Draw:
    """`draw`, which says so in the panel where it fails."""

    @functools.wraps(draw)
    def drawn(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        try:
            draw(layout, context)
        except Exception as error:
            paragraph(layout, context, said_of(error), "ERROR")

    return drawn
