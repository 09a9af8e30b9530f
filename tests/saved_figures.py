"""What charts show, asked of the figures themselves while they are saved."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.text import Text


@contextmanager
def saved_figures() -> Iterator[dict[str, Figure]]:
    """The figures that are saved meanwhile, by the names of their files."""
    found: dict[str, Figure] = {}
    save = Figure.savefig

    def savefig(figure: Figure, path: Path, **options: object) -> None:
        found[path.name] = figure
        save(figure, path, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", savefig)
        yield found


def points_of(figure: Figure) -> set[tuple[float, float]]:
    """The places of all lines' and dots' points, in the numbers of the axes, to 6 digits."""
    found = [line.get_xydata() for ax in figure.axes for line in ax.lines]
    for ax in figure.axes:
        dots = (each for each in ax.collections if isinstance(each, PathCollection))
        found += [np.ma.getdata(each.get_offsets()) for each in dots]
    return {(rounded(x), rounded(y)) for points in found for x, y in np.asarray(points, float)}


def rounded(value: float) -> float:
    return float(f"{value:.6g}")


def texts_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.findobj(Text)]
