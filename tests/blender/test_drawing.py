"""Text over several lines, as wide as Blender's interface draws it."""

from __future__ import annotations

import bpy
import pytest

from tvbrdf.tvbrdf_addon.drawing import wrapped

TEXT = "Rust is for bare or painted steel; this looks like concrete or plaster."


@pytest.mark.parametrize("width", [90, 130, 260])
def test_lines_fit_and_no_word_is_lost(width: float):
    import blf  # only there once bpy is

    blf.size(0, bpy.context.preferences.ui_styles[0].widget.points)
    lines = wrapped(TEXT, width)
    assert " ".join(lines) == TEXT
    assert all(blf.dimensions(0, line)[0] <= width for line in lines)
    firsts = [line.split()[0] for line in lines[1:]]
    for line, word in zip(lines, firsts, strict=False):
        assert blf.dimensions(0, f"{line} {word}")[0] > width, "no line ends early"


def test_a_word_that_is_too_long_has_a_line_of_its_own():
    assert wrapped("a weathered_wood b", 10) == ["a", "weathered_wood", "b"]
    assert wrapped("", 10) == []
