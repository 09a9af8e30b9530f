"""How charts and pictures look, whichever report shows them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from torch import Tensor

from model_runtime.contract import AFFINE, CONSTANT, LSTM_LATENTS, LSTM_PARAMETERS

__all__ = ("LOOKS", "Look", "bare", "compared", "grid", "legend", "panels", "pixels_in_place")

ERROR_COLORS = "inferno"


@dataclass(frozen=True)
class Look:
    """What a method is called in tables and charts; its color (Okabe and Ito's, safe for the color
    blind, as far as they go) and its marker.
    """

    title: str
    color: str
    marker: str = "o"


LOOKS: Mapping[str, Look] = {
    "ours": Look("ours", "#0072B2"),
    "paper": Look("paper", "#D55E00", "s"),
    "paper_long": Look("paper, long", "#CC79A7", "D"),
    "brdfnps": Look("BRDFNPs", "#E69F00", "^"),
    "deepbrdf": Look("DeepBRDF", "#8B5A2B", "p"),
    "hyperbrdf": Look("HyperBRDF", "#6A3D9A", "h"),
    "nbrdf": Look("NBRDF", "#009E73", "v"),
    "one_lobe": Look("1 lobe", "#999999", "P"),
    "two_lobes": Look("2 lobes", "#56B4E9", "X"),
    "three_lobes": Look("3 lobes", "#000000", "*"),
    "stt": Look("STT", "#009E73"),
    "staf": Look("STAF", "#CC79A7"),
    CONSTANT: Look("constant", "#999999"),
    AFFINE: Look("affine", "#000000"),
    LSTM_PARAMETERS: Look("LSTM, parameters", "#56B4E9"),
    LSTM_LATENTS: Look("LSTM, latents", "#8B5A2B"),
}
"""By method, in the order of tables. What holds BRDFs never meets what changes them, but for ours,
paper and BRDFNPs: their colors are used twice."""


def panels(
    count: int, columns: int, size: tuple[float, float], *, sharey: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure of `count` panels, at most `columns` beside each other; `size` in inches is the
    whole's width and a row's height, to which the legend adds.
    """
    columns = min(columns, count)
    rows = -(-count // columns)
    figure = Figure(figsize=(size[0], size[1] * rows + 0.7), layout="constrained")
    every = figure.subplots(rows, columns, squeeze=False, sharey=sharey).ravel()
    for ax in every[count:]:
        ax.set_visible(False)
    return figure, list(every[:count])


def grid(ax: Axes, title: str = "", x: str = "", y: str = "", **options: object) -> None:
    """Pale lines behind the data, a title and what the axes count."""
    ax.grid(color="#dddddd", linewidth=0.6, **options)  # pyright: ignore[reportArgumentType]
    ax.set_title(title, fontsize=10)
    ax.set_xlabel(x, fontsize=9)
    ax.set_ylabel(y, fontsize=9)


def legend(figure: Figure, methods: Iterable[str], more: Sequence[Line2D] = ()) -> None:
    """Above all panels: the methods as they are drawn, and `more`."""
    handles = [
        Line2D([], [], color=look.color, marker=look.marker, label=look.title)
        for look in map(LOOKS.__getitem__, methods)
    ]
    handles += more
    figure.legend(handles=handles, loc="outside upper center", ncols=5, frameon=False)


def pixels_in_place(pixels: Tensor, inside: Tensor) -> NDArray[np.float32]:
    """`pixels` [P, 3] where `inside` [S, S] has them, as RGBA [S, S, 4], nothing around them;
    [P] as they are, [S, S], NaN around.
    """
    if pixels.ndim == 1:
        image = torch.full(inside.shape, torch.nan)
        image[inside] = pixels.float()
        return image.numpy()
    image = torch.zeros(*inside.shape, 4)
    image[inside] = torch.cat((pixels.float().clamp(0, 1), torch.ones(len(pixels), 1)), 1)
    return image.numpy()


def bare(ax: Axes, image: NDArray[np.float32] | None = None, **options: object) -> None:
    """A picture without a frame; without a picture, nothing."""
    ax.set_xticks([])
    ax.set_yticks([])
    for side in ax.spines.values():
        side.set_visible(False)
    if image is not None:
        ax.imshow(image, interpolation="nearest", **options)  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True)
class Shown:
    """Tone-mapped pixels [P, 3] of a method, and what is written below its error."""

    pixels: Tensor
    text: str


def compared(
    columns: Sequence[tuple[str, Tensor, Mapping[str, Shown]]],
    methods: Sequence[str],
    inside: Tensor,
    scale: float,
) -> tuple[Figure, NDArray[np.object_]]:
    """The true picture of every column (title, pixels [P, 3], what methods show), and each of
    `methods` above its mean absolute error, which is white from `scale` on.
    """
    rows, cell, margin, gap = 1 + 2 * len(methods), 1.28, 0.95, 0.125
    width = cell * (len(columns) + gap * (len(columns) - 1)) + 2 * margin
    height = cell * (rows + gap * (rows - 1)) + margin
    figure = Figure(figsize=(width, height))
    place = {
        "left": margin / width,
        "right": 1 - margin / width,
        "top": 1 - 0.6 * margin / height,
        "bottom": 0.4 * margin / height,
        "wspace": gap,
        "hspace": gap,
    }
    axes = figure.subplots(rows, len(columns), squeeze=False, gridspec_kw=place)
    for column, (title, truth, shown) in zip(axes.T, columns, strict=True):
        column[0].set_title(title, fontsize=8)
        bare(column[0], pixels_in_place(truth, inside))
        for i, name in enumerate(methods):
            above, below = column[1 + 2 * i : 3 + 2 * i]
            bare(below)
            if name not in shown:
                bare(above)
                above.text(0.5, 0.5, "is the data", ha="center", va="center", fontsize=8)
                continue
            bare(above, pixels_in_place(shown[name].pixels, inside))
            error = (shown[name].pixels.float() - truth.float()).abs().mean(-1)
            bare(below, pixels_in_place(error, inside), cmap=ERROR_COLORS, vmin=0, vmax=scale)
            below.set_xlabel(shown[name].text, fontsize=8, labelpad=1)
    names = [text for name in methods for text in (LOOKS[name].title, "error")]
    for ax, name in zip(axes[:, 0], ["truth", *names], strict=True):
        ax.set_ylabel(name, rotation=0, ha="right", va="center", fontsize=10)
    return figure, axes


def save(figure: Figure, path: Path) -> None:
    """Write it as PNG."""
    figure.savefig(path, dpi=100)
