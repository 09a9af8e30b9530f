"""The report `representation` for readers: `representation.md` and the images it shows."""

from __future__ import annotations

from pathlib import Path

from .charts import SET_TITLES, chart_frames, chart_materials, chart_speed
from .methods import METHODS
from .results import Cell, Report
from .sets import SETS
from .spheres import PAGES, draw_pages

__all__ = ("INTERPOLATION", "main_table", "write_report")

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
)
INTERPOLATION = "interpolation.png"


def main_table(report: Report) -> str:
    """Methods by sets, `mean / worst` in dB, as Markdown."""
    sets = [name for name in SETS if any(name in m.cells for m in report.methods.values())]
    lines = [
        "| PSNR in dB, mean / worst | " + " | ".join(METHODS[key].title for key in report.methods),
        "|---" * (1 + len(report.methods)) + "|",
    ]
    lines[0] += " |"
    for name in sets:
        cells = [_cell(m.cells.get(name)) for m in report.methods.values()]
        n = next(len(m.cells[name].materials) for m in report.methods.values() if name in m.cells)
        lines.append(f"| {SET_TITLES[name]} ({n}) | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(cell: Cell | None) -> str:
    return "(the data)" if cell is None else f"{cell.mean:.1f} / {cell.worst:.1f}"


def _cost_table(report: Report) -> str:
    lines = [
        "| method | parameters | latent dimensions | directions m (texel) | encode, ms |"
        " decode, µs a sample | training, min | iterations |",
        "|---" * 8 + "|",
    ]
    for key, method in report.methods.items():
        cost = method.cost
        values = (
            METHODS[key].title,
            f"{cost.parameters:,}",
            f"{cost.latent_dims:,}",
            f"{cost.samples:,} ({cost.texel_samples:,})",
            f"{cost.encode_ms:.3g}" if cost.encode_ms < 100 else f"{cost.encode_ms:,.0f}",
            f"{cost.decode_us_per_sample:.2g}",
            "" if cost.train_minutes is None else f"{cost.train_minutes:g}",
            "" if cost.train_iterations is None else f"{cost.train_iterations:,}",
        )
        lines.append("| " + " | ".join(values) + " |")
    return "\n".join(lines)


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
- Frames of tvBTF45 (its centre) and SnowyGround are wrapped over the sphere; a texel covers 4 x 4 \
pixels, which leaves about 200 distinct BRDFs in the visible disc. Values are clamped to what can \
be rendered. One score a frame, five frames.
- Times are of one core; encoders work in batches of up to 64 BRDFs.
"""


def _alternative(file: str) -> str:
    return file.removesuffix(".png").replace("_", " ")


def write_report(report: Report, folder: Path) -> None:
    """Write `representation.md` and its charts and pictures to `folder`; of an interpolation that
    is there already, a link.
    """
    parts = [
        "# BRDF representations",
        main_table(report),
        _explanation(report),
        "## Cost",
        _cost_table(report),
        "## Charts",
    ]
    for file, draw, caption in _CHARTS:
        if draw(report, folder / file):
            parts += [f"![{_alternative(file)}]({file})", caption]
    pages = draw_pages(report, folder)
    if pages:
        first = METHODS[next(iter(report.methods))].title
        parts += [
            "## Spheres",
            "Under the overcast street `potsdamer_platz`, materials chosen by the score of"
            f" {first}. Errors are mean absolute differences of tone-mapped channels, on one scale"
            " everywhere; the numbers are PSNR over all three maps.",
        ]
        for page, file in zip(PAGES, pages, strict=True):
            parts += [f"### The {page} ten", f"![the {page} ten]({file})"]
    if (folder / INTERPOLATION).exists():
        caption = "Latents of two materials, mixed linearly and decoded; the truth at both ends."
        parts += [
            "## Between materials",
            f"![{_alternative(INTERPOLATION)}]({INTERPOLATION})",
            caption,
        ]
    (folder / "representation.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
