"""The report's pictures: rendered spheres beside the truth, and a walk from latent to latent."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap

import torch
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from model_runtime.representation.latents import PAPER_SAMPLES

from ...baselines.encoders import Encoder
from ...data.nbrdf import load
from ...metric.sphere import Sphere
from ..bench.charts import ERROR_COLORS, Shown, bare, compared, panels, pixels_in_place, save
from ..bench.spheres import picture
from .charts import SET_TITLES
from .results import Report
from .sets import BAD_FITS, UNIFORM

__all__ = ("PAGES", "draw_interpolation", "draw_pages")

PAGES = ("best", "median", "worst")
PAIRS = (("nickel", "red-fabric"), ("gold-metallic-paint3", "blue-metallic-paint"))
"""MERL materials to walk between: a metal and a cloth; gold and a blue paint."""

_COLUMNS = 10
_STEPS = 7
_ERROR_SCALE = 0.1

Material = tuple[str, str]


def draw_pages(report: Report, folder: Path) -> list[str]:
    """Write `spheres_best.png`, `_median` and `_worst`: the first method's ten best, median and
    worst uniform materials, every method and its error. Returns the names of the files.
    """
    first = next(iter(report.methods.values()))
    known = [(s, name) for s, name in first.pictures if s in UNIFORM and name not in BAD_FITS]
    ranked = sorted(known, key=lambda key: first.pictures[key].score)
    if not ranked:
        return []
    middle = max(0, (len(ranked) - _COLUMNS) // 2)
    pages = (
        ranked[: -_COLUMNS - 1 : -1],
        ranked[middle : middle + _COLUMNS],
        ranked[:_COLUMNS],
    )
    files = [f"spheres_{page}.png" for page in PAGES]
    for file, materials in zip(files, pages, strict=True):
        _page(report, materials, folder / file)
    return files


def _page(report: Report, materials: Sequence[Material], path: Path) -> None:
    """Columns are materials; rows the truth, then each method above its error."""
    columns = []
    for key in materials:
        shown = {
            name: Shown(method.pictures[key].pixels, f"{method.pictures[key].score:.1f} dB")
            for name, method in report.methods.items()
            if key in method.pictures
        }
        columns.append((_title(*key), report.truth[key], shown))
    figure, axes = compared(columns, tuple(report.methods), report.inside, _ERROR_SCALE)
    width, right = figure.get_figwidth(), axes[0, -1].get_position().x1
    bar = figure.add_axes((right + 0.15 / width, 0.3, 0.15 / width, 0.4))
    scale = ScalarMappable(Normalize(0, _ERROR_SCALE), ERROR_COLORS)
    figure.colorbar(scale, cax=bar).set_label("error of a tone-mapped pixel (0 to 1)", fontsize=8)
    bar.tick_params(labelsize=7)
    save(figure, path)


def _title(set_name: str, name: str) -> str:
    words = name.removesuffix("_rgb").replace("_", " ").replace("-", " ")
    return "\n".join((SET_TITLES[set_name], *wrap(words, 20)))


@torch.no_grad()
def draw_interpolation(model: Encoder, sphere: Sphere, data: Path, path: Path) -> None:
    """Two pairs of MERL materials and seven steps on the line between their latents; the truth at
    both ends.
    """
    networks = load(data, "merl")
    columns = _STEPS + 2
    figure, axes = panels(len(PAIRS) * columns, columns, (1.28 * columns + 0.2, 1.3))
    share = torch.linspace(0, 1, _STEPS)[:, None]
    angles = model.sample_angles(PAPER_SAMPLES)
    every = torch.arange(2)
    for row, pair in enumerate(PAIRS):
        ends = networks.select(list(pair))
        latents = model.encode(angles, ends.evaluate(every, angles))
        first, second = latents.flat()[:1], latents.flat()[1:]
        steps = latents.unflat(torch.lerp(first, second, share))
        truth = picture(sphere.render(lambda a, ends=ends: ends.evaluate(every, a)))
        walk = picture(sphere.render(lambda a, steps=steps: model.decode(steps, a)))
        shares = [f"{100 * value:.0f} %" for value in share[:, 0].tolist()]
        titles = [f"truth\n{pair[0]}", *shares, f"truth\n{pair[1]}"]
        shown = zip(titles, torch.cat((truth[:1], walk, truth[1:])), strict=True)
        for ax, (title, pixels) in zip(axes[row * columns :], shown, strict=False):
            bare(ax, pixels_in_place(pixels, sphere.inside))
            ax.set_title(title, fontsize=7.5)
    save(figure, path)
