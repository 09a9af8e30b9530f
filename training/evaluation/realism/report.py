"""The report `realism` for readers: `realism.md`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ..bench.results import image, table
from .results import RealismReport

__all__ = ("page", "tables")

_MARKS = {True: "yes", False: "**no**", None: ""}

_ABOUT = """\
Distances are sliced Wasserstein distances between what VGG16 sees in two pictures (pixels and the \
features after conv1_2, 2_2, 3_3 and 4_3; 64 directions; each in standard deviations of both \
together; their mean): 0 for the same picture, 0.03 to 0.2 for two parts of one scan, about 1 for \
its mean color.

- **Scans**: methods learn from the left half and age a material that was quilted of what is \
clean there. *Fully*: all of it weathered for good (`age --onset none`) against a picture quilted \
of what is weathered in the right half; *same_scan* is the like of the left half. *Half way* \
(`_half`): the picture whose mean color is that of the right half, against all of it.
- **Metals**: the bundled rust, against other scans of rust, and half way against the right half \
of Metal022.
- **Rusts**: how far what is rust in the left half of one scan is from that in the right half of \
another, or its own.
- **copper**: the upper half of a film is learned from, the first picture of the lower half aged \
(*ode* starts from noise), and at each age the picture with the film's mean color is held against \
the film; *ode* and *same_scan*, the upper half, are taken at that moment. Ages are shares of time.
- *ours* is `training learn` and `age`; *ours_v1* are the formulas that the models of the release \
before had learned, themselves; *crossfade* fades to the source's mean weathered color; *stt* and \
*paper* learn from the sequence that `training scan` writes, in which neighbors are no neighbors; \
the paper's texels are aged 256 distinct ones at a time. *same_scan* and *other_scan* are scans.
- Seconds are those of a core, to age the material; learning comes on top.
"""


def page(report: RealismReport, drawn: Iterable[Path]) -> list[str]:
    """The paragraphs of `realism.md`, with the pictures `drawn` beside it."""
    pictures = [image(path.name, path.stem.replace("_", " ")) for path in drawn]
    return ["# Realism", _ABOUT, tables(report), "## Pictures", *pictures]


def tables(report: RealismReport) -> str:
    """The figures that were asked for, and the distances of all methods, in Markdown."""
    rows = [[f.name, f.asked, f.measured, _MARKS[f.met]] for f in report.figures]
    figures = table(("figure", "asked", "measured", "met"), rows)
    parts = (figures, _distances(report), _rusts(report), _costs(report))
    return "\n\n".join(filter(None, parts))


def _distances(report: RealismReport) -> str:
    names = report.settings["methods"]
    rows = []
    for name, target in report.targets.items():
        found = target.methods
        cells = [f"{found[each].distance:.3f}" if each in found else "" for each in names]
        rows.append([name, *cells])
    return table(("target", *names), rows) if rows else ""


def _rusts(report: RealismReport) -> str:
    rows = [
        [name, *(f"{apart:.3f}" for apart in others.values())]
        for name, others in report.rusts.items()
    ]
    return table(("rust of", *report.rusts), rows) if rows else ""


def _costs(report: RealismReport) -> str:
    rows, names = [], ()
    for method, costs in report.costs.items():
        played = {name: seconds for name, seconds in costs.items() if name.startswith("picture_")}
        names = tuple(f"a picture of {name.removeprefix('picture_')}, s" for name in played)
        seconds = [f"{each:.2f}" for each in played.values()]
        rows.append([method, f"{costs['learn']:.0f}", *seconds, f"{costs['bytes'] / 1e6:.2f}"])
    return table(("copper", "learn, s", *names, "file, MB"), rows) if rows else ""
