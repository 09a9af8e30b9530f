"""The report `representation` for readers: `representation.md` and the images it shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ..bench.charts import LOOKS
from ..bench.results import image, table
from .charts import (
    SET_TITLES,
    chart_frames,
    chart_materials,
    chart_progress,
    chart_speed,
    chart_stability,
)
from .pictures import PAGES, draw_pages
from .results import Report
from .sets import SETS

__all__ = ("INTERPOLATION", "main_table", "page")

_CHARTS = (
    (
        "representation_materials.png",
        chart_materials,
        "A dot a material, sorted by the first method; dotted lines are means; a hollow dot is a"
        " material whose truth is a bad fit.",
    ),
    (
        "representation_speed.png",
        chart_speed,
        "Time to encode a BRDF against mean PSNR, on a fixed part of every uniform set and smaller"
        " spheres. Along a curve the number of directions m grows; the large marker is the method"
        " as in the table. NBRDF's time is its training: the solid line runs over iterations at"
        " m = 16,200, the dashed one over m.",
    ),
    (
        "representation_frames.png",
        chart_frames,
        "The two time-varying textures at five times (the paper's figure 6).",
    ),
    (
        "representation_progress.png",
        chart_progress,
        "Seen and unseen measured materials while the encoders were trained (spheres of 12 pixels,"
        " every fourth seen material).",
    ),
    (
        "representation_stability.png",
        chart_stability,
        "Damage to what an encoder reads: 16 materials, MERL held out, RGL, Disney and"
        " Torrance-Sparrow, against the undamaged truth. A hole is what a method cannot be told.",
    ),
)
INTERPOLATION = "interpolation.png"


def main_table(report: Report) -> str:
    """Methods by sets, `mean / worst` in dB, as Markdown."""
    rows = []
    for name in SETS:
        cells = [m.cells.get(name) for m in report.methods.values()]
        count = next((cell.n for cell in cells if cell), None)
        if count is not None:
            texts = [f"{c.mean:.1f} / {c.min:.1f}" if c else "(the data)" for c in cells]
            rows.append([f"{SET_TITLES[name]} ({count})", *texts])
    titles = (LOOKS[key].title for key in report.methods)
    return table(["PSNR in dB, mean / worst", *titles], rows)


def _cost_table(report: Report) -> str:
    head = """method, parameters, latent dimensions, directions m (texel), encode; ms,
        measured: checked and refined; ms, decode; µs a sample, training; min, iterations"""
    rows = []
    for key, method in report.methods.items():
        cost = method.cost
        rows.append(
            [
                LOOKS[key].title,
                f"{cost.parameters:,}",
                f"{cost.latent_dims:,}",
                f"{cost.samples:,} ({cost.texel_samples:,})",
                f"{cost.encode_ms:.3g}" if cost.encode_ms < 100 else f"{cost.encode_ms:,.0f}",
                "" if cost.refine_ms is None else f"{cost.refine_ms:,.0f}",
                f"{cost.decode_us_per_sample:.2g}",
                "" if cost.train_minutes is None else f"{cost.train_minutes:g}",
                "" if cost.train_iterations is None else f"{cost.train_iterations:,}",
            ]
        )
    return table([title.strip().replace(";", ",") for title in head.split(",")], rows)


_PROPERTIES: tuple[tuple[str, Callable[[Mapping[str, Any]], str]], ...] = (
    (
        "channels permuted: change of shared latents / of color latents put back / of the decoded",
        lambda p: " / ".join(
            f"{p['color_permutation'][key]:.0e}" for key in ("shared", "color", "decoded")
        ),
    ),
    (
        "light and eye exchanged: largest relative change",
        lambda p: f"{p['reciprocity']['single']:.0e}",
    ),
    (
        "to 89.9 degrees and mirror peaks: least / largest value",
        lambda p: (
            f"{p['range']['min']:.2g} / {p['range']['max']:.5g}"
            + ("" if p["range"]["finite"] else ", not finite")
        ),
    ),
    *(
        (
            f"light added, {title}: all incidences together / worst single incidence",
            lambda p, key=key: (
                f"{p['energy'][key]['diffuse_excess']:.1%} / {p['energy'][key]['excess']:.1%}"
            ),
        )
        for key, title in (
            ("torrance_sparrow", "Torrance-Sparrow"),
            ("mirrors", "mirrors"),
            ("bright", "albedo above 1"),
            ("disney", "Disney"),
            ("merl_held_out", "MERL held out"),
            ("rgl", "RGL"),
        )
    ),
    (
        "batches of 1, 7, 64 and 1 or 2 threads: change of latents / of the decoded",
        lambda p: f"{p['agreement']['latents']:.0e} / {p['agreement']['decoded']:.0e}",
    ),
    (
        "near latents, near pictures: rank correlation",
        lambda p: f"{p['neighborhood']['rank_correlation']:.2f}",
    ),
    (
        "parametric materials, mean / worst dB: sampled, and from their parameters",
        lambda p: (
            f"{p['short_cut']['sampled']:.1f} / {p['short_cut']['sampled_min']:.1f},"
            f" {p['short_cut']['short']:.1f} / {p['short_cut']['short_min']:.1f}"
        ),
    ),
)


def _property_table(report: Report) -> str:
    """What `measure_properties` found, a row a property, a column a method."""
    known = {key: m.properties for key, m in report.methods.items() if m.properties}
    rows = [[title, *(cell(p) for p in known.values())] for title, cell in _PROPERTIES]
    return table(["property", *(LOOKS[key].title for key in known)], rows)


def _explanation(report: Report) -> str:
    return f"""PSNR of tone-mapped spheres, {report.pixels} pixels wide, averaged over three \
environment maps and then over materials. What is left out, and what the figures are of:

- **(the data)**: the truth of MERL and RGL is NBRDF's own published networks, so NBRDF has \
nothing to prove there.
- `chm_orange_rgb` (RGL) is a bad fit of its measurement (albedo above 1): it is in the mean and \
in the list of materials, but it is not counted as a worst, nor in the 5 % quantile.
- NBRDF is trained here, a network a material, at the directions that the paper's encoder reads; \
its time to encode is the training of a uniform material, and its minutes are those of all \
networks of the table.
- Frames of tvBTF45 (its center) and SnowyGround are wrapped over the sphere; a texel covers 4 x 4 \
pixels, which leaves about 200 distinct BRDFs in the visible disc. Values are clamped to what can \
be rendered. One score a frame, five frames.
- Ours checks measured materials (MERL, RGL, .bsdf) against directions that it has not read, and \
refines what is off, as `age` does; its curve over time below is the encoder's alone.
- Times are of one core; encoders work in batches of up to 64 BRDFs.
"""


def _alternative(file: str) -> str:
    return file.removesuffix(".png").replace("_", " ")


def page(report: Report, folder: Path) -> list[str]:
    """The paragraphs of `representation.md`; draws its charts and pictures to `folder`. Of an
    interpolation that is there already, a link.
    """
    parts = [
        "# BRDF representations",
        main_table(report),
        _explanation(report),
        "## Cost",
        _cost_table(report),
        "## Properties",
        _property_table(report),
        "Light added is decoded minus true albedo, in shares of the incident light.",
        "## Charts",
    ]
    for file, draw, caption in _CHARTS:
        if draw(report, folder / file):
            parts += [image(file, _alternative(file)), caption]
    pages = draw_pages(report, folder)
    if pages:
        first = LOOKS[next(iter(report.methods))].title
        parts += [
            "## Spheres",
            "Under the overcast street `potsdamer_platz`, materials chosen by the score of"
            f" {first}. Errors are mean absolute differences of tone-mapped channels, on one scale"
            " everywhere; the numbers are PSNR over all three maps.",
        ]
        for which, file in zip(PAGES, pages, strict=True):
            parts += [f"### The {which} ten", image(file, f"the {which} ten")]
    if (folder / INTERPOLATION).exists():
        parts += [
            "## Between materials",
            image(INTERPOLATION, _alternative(INTERPOLATION)),
            "Latents of two materials, mixed linearly and decoded; the truth at both ends.",
        ]
    return parts
