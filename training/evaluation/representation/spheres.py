"""The report's pictures: rendered spheres beside the truth, and a walk from latent to latent."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from torch import Tensor

from model_runtime.representation import Trained
from model_runtime.representation.latents import PAPER_SAMPLES

from ...data.nbrdf import load
from ...metric.sphere import Sphere, tone_map
from .charts import SET_TITLES
from .methods import METHODS
from .results import Report
from .sets import BAD_FITS, UNIFORM

__all__ = ("PAGES", "draw_interpolation", "draw_pages")

PAGES = ("best", "median", "worst")
PAIRS = (("nickel", "red-fabric"), ("gold-metallic-paint3", "blue-metallic-paint"))
"""MERL materials to walk between: a metal and a cloth; gold and a blue paint."""

_COLUMNS = 10
_STEPS = 7
_CELL = 1.28
_GAP = 0.125
_MARGIN = 0.95
_ERROR_SCALE = 0.1
_ERROR_COLORS = "inferno"

Material = tuple[str, str]


def draw_pages(report: Report, folder: Path) -> list[str]:
    """Write `spheres_best.png`, `_median` and `_worst`: the first method's ten best, median and
    worst uniform materials, every method and its error. Returns the names of the files.
    """
    first = next(iter(report.methods.values()))
    ranked = sorted(
        (
            (set_name, material)
            for set_name, material in first.pictures
            if set_name in UNIFORM and material not in BAD_FITS
        ),
        key=lambda key: first.pictures[key].score,
    )
    if not ranked:
        return []
    middle = max(0, (len(ranked) - _COLUMNS) // 2)
    chosen = (
        ranked[: -_COLUMNS - 1 : -1],
        ranked[middle : middle + _COLUMNS],
        ranked[:_COLUMNS],
    )
    files = []
    for page, materials in zip(PAGES, chosen, strict=True):
        files.append(f"spheres_{page}.png")
        _page(report, materials, folder / files[-1])
    return files


def _page(report: Report, materials: Sequence[Material], path: Path) -> None:
    """Columns are materials; rows the truth, then each method above its error."""
    rows, columns = 1 + 2 * len(report.methods), len(materials)
    width = _CELL * (columns + _GAP * (columns - 1)) + 2 * _MARGIN
    height = _CELL * (rows + _GAP * (rows - 1)) + _MARGIN
    figure = Figure(figsize=(width, height))
    right = 1 - _MARGIN / width
    grid = figure.subplots(
        rows,
        columns,
        squeeze=False,
        gridspec_kw={
            "left": _MARGIN / width,
            "right": right,
            "top": 1 - 0.6 * _MARGIN / height,
            "bottom": 0.4 * _MARGIN / height,
            "wspace": _GAP,
            "hspace": _GAP,
        },
    )
    for column, material in zip(grid.T, materials, strict=True):
        column[0].set_title(_title(*material), fontsize=8)
        _show(column[0], _image(report.truth[material], report.inside))
        for i, method in enumerate(report.methods.values()):
            above, below = column[1 + 2 * i : 3 + 2 * i]
            picture = method.pictures.get(material)
            _show(above, None if picture is None else _image(picture.pixels, report.inside))
            _show(below, None)
            if picture is None:
                above.text(0.5, 0.5, "is the data", ha="center", va="center", fontsize=8)
                continue
            error = (picture.pixels.float() - report.truth[material].float()).abs().mean(-1)
            below.imshow(
                _image(error, report.inside),
                cmap=_ERROR_COLORS,
                vmin=0,
                vmax=_ERROR_SCALE,
                interpolation="nearest",
            )
            below.set_xlabel(f"{picture.score:.1f} dB", fontsize=8, labelpad=1)
    titles = ["truth"]
    for key in report.methods:
        titles += [METHODS[key].title, "error"]
    for ax, title in zip(grid[:, 0], titles, strict=True):
        ax.set_ylabel(title, rotation=0, ha="right", va="center", fontsize=10)
    bar = figure.add_axes((right + 0.15 / width, 0.3, 0.15 / width, 0.4))
    scale = ScalarMappable(Normalize(0, _ERROR_SCALE), _ERROR_COLORS)
    figure.colorbar(scale, cax=bar).set_label("error of a tone-mapped pixel (0 to 1)", fontsize=8)
    bar.tick_params(labelsize=7)
    figure.savefig(path, dpi=100)


def _title(set_name: str, name: str) -> str:
    words = name.removesuffix("_rgb").replace("_", " ").replace("-", " ")
    return "\n".join((SET_TITLES[set_name], *wrap(words, 20)))


def _image(pixels: Tensor, inside: Tensor) -> NDArray[np.float32]:
    """`pixels` [P, 3] in their places as RGBA, nothing around them; [P] as they are, NaN around."""
    if pixels.ndim == 1:
        image = torch.full(inside.shape, torch.nan)
        image[inside] = pixels.float()
        return image.numpy()
    image = torch.zeros(*inside.shape, 4)
    image[inside] = torch.cat((pixels.float().clamp(0, 1), torch.ones(len(pixels), 1)), 1)
    return image.numpy()


def _show(ax: Axes, image: NDArray[np.float32] | None) -> None:
    ax.set_xticks([])
    ax.set_yticks([])
    for side in ax.spines.values():
        side.set_visible(False)
    if image is not None:
        ax.imshow(image, interpolation="nearest")


@torch.no_grad()
def draw_interpolation(model: Trained, sphere: Sphere, shown: int, data: Path, path: Path) -> None:
    """Two pairs of MERL materials and seven steps on the line between their latents, as spheres
    under map `shown`; the truth at both ends.
    """
    networks = load(data, "merl")
    columns = _STEPS + 2
    width = _CELL * columns + 0.2
    height = (_CELL + 0.3) * len(PAIRS) + 0.1
    figure = Figure(figsize=(width, height), layout="constrained")
    grid = figure.subplots(len(PAIRS), columns, squeeze=False)
    share = torch.linspace(0, 1, _STEPS)[:, None]
    angles = model.sample_angles(PAPER_SAMPLES)
    every = torch.arange(2)
    for axes, pair in zip(grid, PAIRS, strict=True):
        ends = networks.select(list(pair))
        latents = model.encode(angles, ends.evaluate(every, angles))
        first, second = latents.flat()[:1], latents.flat()[1:]
        steps = latents.unflat(torch.lerp(first, second, share))
        truth = sphere.render(lambda a, ends=ends: ends.evaluate(every, a))[:, shown]
        walk = sphere.render(lambda a, steps=steps: model.decode(steps, a))[:, shown]
        pictures = torch.cat((truth[:1], walk, truth[1:]))
        titles = [
            f"truth\n{pair[0]}",
            *(f"{100 * value:.0f} %" for value in share[:, 0].tolist()),
            f"truth\n{pair[1]}",
        ]
        for ax, picture, title in zip(axes, pictures, titles, strict=True):
            _show(ax, _image(tone_map(picture), sphere.inside))
            ax.set_title(title, fontsize=7.5)
    figure.savefig(path, dpi=100)
