"""The report `pareto` for readers: `pareto.md`."""

from __future__ import annotations

from ..bench.results import table
from .results import ParetoReport, Point

__all__ = ("tables",)

_DEFAULTS = ("draft, live", "balanced, live", "draft", "balanced", "exact")


def tables(report: ParetoReport) -> str:
    """The figures that were asked for, the points, what each saving is worth and what further lobes
    do, in Markdown.
    """
    return "\n\n".join(
        (
            *("# Speed against accuracy", _figures(report), _points(report), _savings(report)),
            _lobes(report),
        )
    )


def _figures(report: ParetoReport) -> str:
    marks = {True: "yes", False: "**no**", None: ""}
    rows = [
        [f.name, f.asked, f.measured + " (extrapolated)" * f.extrapolated, marks[f.met]]
        for f in report.figures
    ]
    return table(("figure", "asked", "measured", "met"), rows)


def _points(report: ParetoReport) -> str:
    head = (
        *("setting", "core s", "wall s", "dB against exact, mean / worst material", "MB"),
        *("dB against the truth", "core s to model it", "front"),
    )
    lines = [table(head, map(_point, report.points)), "", "\\* worked out from fewer texels."]
    sizes = {point.name: point.megabytes or 0.0 for point in report.points}
    for point in report.points:
        if point.name in _DEFAULTS and not point.front:
            better = ", ".join(f"{name} ({sizes[name]:.0f} MB)" for name in point.beaten_by)
            size = sizes[point.name]
            lines += ["", f"{point.name} ({size:.0f} MB) is not on the front: {better} beat it."]
    return "\n".join(lines)


def _point(point: Point) -> list[str]:
    truth, fronts = point.truth, (("exact", point.front), ("truth", point.truth_front))
    return [
        point.name,
        f"{point.core:,.2f}{_mark(point.extrapolated)}",
        "" if point.wall is None else f"{point.wall:.2f}",
        "" if point.mean is None else f"{point.mean:.1f} / {min(point.psnr.values()):.1f}",
        "" if point.megabytes is None else f"{point.megabytes:.1f}",
        "" if truth is None else f"{point.truth_mean:.1f}",
        "" if truth is None else f"{truth.seconds:.3g}{_mark(truth.extrapolated)}",
        ", ".join(name for name, on in fronts if on),
    ]


def _savings(report: ParetoReport) -> str:
    rows = [[s.name, s.unit, f"{s.without:,.2f}", f"{s.with_it:,.2f}"] for s in report.savings]
    return table(("saving", "", "without", "with"), rows)


def _lobes(report: ParetoReport) -> str:
    """A row a measured material; what `age` takes is bold."""
    rows: dict[str, list[str]] = {}
    for row in report.lobes:
        cell = f"{row['psnr']:.1f} ({row['core']:.2f})"
        cells = rows.setdefault(row["material"], [row["material"]])
        cells.append(f"**{cell}**" if row["chosen"] else cell)
    return table(("measured: dB (core s)", "1 lobe", "2 lobes", "3 lobes"), rows.values())


def _mark(extrapolated: bool) -> str:
    return "\\*" if extrapolated else ""
