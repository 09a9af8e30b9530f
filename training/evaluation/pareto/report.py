"""The report `pareto` for readers: `pareto.md`."""

from __future__ import annotations

from .results import ParetoReport, Point

__all__ = ("tables",)

_DEFAULTS = ("draft, live", "balanced, live", "draft", "balanced", "exact")


def tables(report: ParetoReport) -> str:
    """The figures that were asked for, the points and what each saving is worth, in Markdown."""
    return "\n\n".join(
        ("# Speed against accuracy", _figures(report), _points(report), _savings(report))
    )


def _figures(report: ParetoReport) -> str:
    marks = {True: "yes", False: "**no**", None: ""}
    lines = ["| figure | asked | measured | met |", "|---|---|---|---|"]
    for figure in report.figures:
        measured = figure.measured + " (extrapolated)" * figure.extrapolated
        lines.append(f"| {figure.name} | {figure.asked} | {measured} | {marks[figure.met]} |")
    return "\n".join(lines)


def _points(report: ParetoReport) -> str:
    lines = [
        "| setting | core s | wall s | dB against exact, mean / worst material | MB "
        "| dB against the truth | core s to model it | front |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for point in report.points:
        psnr = "" if point.mean is None else f"{point.mean:.1f} / {min(point.psnr.values()):.1f}"
        truth = (
            ("", "")
            if point.truth is None
            else (
                f"{point.truth_mean:.1f}",
                f"{point.truth.seconds:.3g}{_mark(point.truth.extrapolated)}",
            )
        )
        wall = "" if point.wall is None else f"{point.wall:.2f}"
        size = "" if point.megabytes is None else f"{point.megabytes:.1f}"
        core = f"{point.core:,.2f}{_mark(point.extrapolated)}"
        lines.append(
            f"| {point.name} | {core} | {wall} | {psnr} | {size} | {truth[0]} | {truth[1]} "
            f"| {_front(point)} |"
        )
    lines += ["", "\\* worked out from fewer texels."]
    sizes = {point.name: point.megabytes or 0.0 for point in report.points}
    for point in report.points:
        if point.name in _DEFAULTS and not point.front:
            better = ", ".join(f"{name} ({sizes[name]:.0f} MB)" for name in point.beaten_by)
            size = sizes[point.name]
            lines += ["", f"{point.name} ({size:.0f} MB) is not on the front: {better} beat it."]
    return "\n".join(lines)


def _savings(report: ParetoReport) -> str:
    lines = ["| saving | | without | with |", "|---|---|---|---|"]
    for saving in report.savings:
        numbers = f"{saving.without:,.2f} | {saving.with_it:,.2f}"
        lines.append(f"| {saving.name} | {saving.unit} | {numbers} |")
    return "\n".join(lines)


def _front(point: Point) -> str:
    return ", ".join(
        name for name, on in (("exact", point.front), ("truth", point.truth_front)) if on
    )


def _mark(extrapolated: bool) -> str:
    return "\\*" if extrapolated else ""
