"""Whether what grows looks like what really grew: `python -m training evaluate realism`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from collections.abc import Sequence as Names
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from model_runtime.errors import InputError
from model_runtime.maps import PrincipledMaps
from model_runtime.model_files.weights import find_model

from ...metric.texture import TextureMetric, encoded
from ..bench.results import chosen, write_report
from ..synthesis.sources import Effort
from .aging import Aging, Source, nearest_in_mean
from .comparing import Comparison, Picture
from .figures import HALF_WAY, figures_of
from .film import COPPER, costs_of, film_of
from .growing import relief_of, spots_of
from .methods import METHODS, Aged
from .pictures import draw_chart, draw_relief, draw_sheet, draw_spots, draw_strip
from .report import page
from .results import Compared, RealismReport, Target
from .targets import METALS, RUST, RUSTED, SCANS, Half, HalvedScan, read_part, scan_folder

__all__ = ("EVERY", "TARGETS", "evaluate_realism")

EVERY = (*METHODS, "ode", "same_scan", "other_scan")
"""The methods of the report; `ode` has learned copper alone, the last two are real."""

TARGETS = (*SCANS, *METALS, COPPER, "rusts", "relief", "spots")

_RUST = "rust"
_RUSTED = "Metal022"
_EFFORT = Effort(rival_texels=64)

Shown = dict[str, Picture]


@dataclass
class _Bench:
    """What all targets share; `sheets` are pictures by name and row, `strip` the film's by age."""

    data: Path
    aging: Aging
    comparison: Comparison
    names: tuple[str, ...]
    size: int
    sheets: dict[str, dict[str, Shown]] = field(default_factory=dict)
    strip: dict[str, Shown] = field(default_factory=dict)
    _scans: dict[str, HalvedScan] = field(default_factory=dict)

    def scan(self, name: str) -> HalvedScan:
        """A scan in halves."""
        if name not in self._scans:
            self._scans[name] = HalvedScan.read(self.data, name, self.size)
        return self._scans[name]

    def aged(
        self, key: str, clean: Callable[[], PrincipledMaps], source: Source, ntm: Path
    ) -> dict[str, Aged]:
        """What all methods make of a material."""
        names = [name for name in self.names if name in METHODS]
        return {name: self.aging.aged(name, key, clean, source, ntm) for name in names}

    def target(self, truth: Picture, shown: Shown, learned: float | None) -> Target:
        """How far what is `shown` is from the truth."""
        found = {
            name: Compared(self.comparison.distance(each, truth), each.time, each.seconds)
            for name, each in shown.items()
            if name in self.names
        }
        return Target(found, learned)


def evaluate_realism(
    data: Path,
    output: Path,
    *,
    methods: Names[str] | None = None,
    targets: Names[str] | None = None,
    size: int = 1024,
    times: int = 9,
    effort: Effort = _EFFORT,
    minutes: float | None = None,
) -> RealismReport:
    """Hold what `methods` make of clean materials against scans (default: all of `EVERY` and
    `TARGETS`); write `realism.json`, `.md` and pictures to `output`.

    Of scans the upper left `size` x `size` texels are read, of what is aged half as many a side are
    looked at, and histories have so many `times`. What is learned, aged and compared stays in
    `output`/kept, so that the next call, or one after an interruption, is quick. `effort` is spent
    on the paper's method, `minutes` (None: as many as the product takes) on ours.
    Raises `UsageError` for methods and targets that do not exist, InputError where data is missing.
    """
    names, wanted = chosen("method", methods, EVERY), chosen("target", targets, TARGETS)
    start = time.perf_counter()
    folder = output / "kept"
    aging = Aging(folder, times, size // 2, effort, minutes)
    comparison = Comparison(folder, TextureMetric.load(data / "perceptual"))
    bench = _Bench(data, aging, comparison, names, size)
    found: dict[str, Target] = {}
    rusts: Mapping[str, Mapping[str, float]] = {}
    relief: Mapping[str, Any] = {}
    spots: Mapping[str, Any] = {}
    costs: Mapping[str, Any] = {}
    for name in tqdm(wanted, desc="targets", unit=" target"):
        if name == "rusts":
            rusts = _rusts(bench)
        elif name == "relief":
            relief = relief_of(bench.scan("PaintedMetal007"), aging)
        elif name == "spots":
            spots = spots_of(data, aging, names)
        elif name == COPPER:
            found |= _film(bench)
            costs = costs_of(data, aging, (size // 4, size)) if "ode" in names else {}
        else:
            found |= _scan(bench, name) if name in SCANS else _metal(bench, name)
    settings = {"size": size, "times": times, "methods": list(names)}
    spent = time.perf_counter() - start
    figures = figures_of(found, relief, spots)
    report = RealismReport(figures, found, rusts, relief, spots, costs, settings, spent)
    output.mkdir(parents=True, exist_ok=True)
    drawn = [draw_chart(report, output)]
    drawn += [draw_relief(relief, output)] if relief else []
    drawn += [draw_spots(spots, output)] if spots else []
    drawn += [draw_strip(bench.strip, output)] if bench.strip else []
    drawn += [draw_sheet(name, rows, output) for name, rows in bench.sheets.items()]
    write_report(output, "realism", page(report, drawn), report)
    return report


def _scan(bench: _Bench, name: str) -> dict[str, Target]:
    """Learned from the left half, held against the right one, fully and half weathered."""
    scan = bench.scan(name)
    source = Source(scan)
    learned = bench.aging.of_scan(source)
    aged = bench.aged(name, lambda: scan.clean, source, learned.path)
    other = _other(bench.data, scan.kind.other, bench.size)
    right = _whole(scan.right)
    half = _at_mean(aged, right.pixels)
    real = {"same_scan": _whole(scan.left), "other_scan": other[0]}
    full = {"same_scan": Picture(scan.weathered(scan.left)), "other_scan": other[1]}
    gone = Picture(scan.weathered(scan.right))
    bench.sheets[name] = {
        "half way": {"truth": right, **half, **real},
        "fully": {"truth": gone, **_at_end(aged), **full},
    }
    return {
        name: bench.target(gone, {**_at_end(aged), **full}, learned.seconds),
        name + HALF_WAY: bench.target(right, {**half, **real}, learned.seconds),
    }


def _metal(bench: _Bench, name: str) -> dict[str, Target]:
    """The bundled rust on a clean metal, held against other scans of rust, and half way against
    one that is half rusted.
    """
    source = Source(bench.scan(_RUSTED))
    folder = scan_folder(bench.data, name)
    aged = bench.aged(name, lambda: read_part(folder, bench.size), source, find_model(_RUST))
    found, shown = {}, _at_end(aged)
    halves = [_halves(bench.data, rust, bench.size) for rust in RUST]
    for i, rust in enumerate(RUST):
        left, right = halves[i]
        full = {"same_scan": left, "other_scan": halves[1 - i][0]}
        found[f"{name}_{rust}"] = bench.target(right, {**shown, **full}, None)
    scan = source.scan
    right = _whole(scan.right)
    half = _at_mean(aged, right.pixels)
    real = {"same_scan": _whole(scan.left)}
    found[name + HALF_WAY] = bench.target(right, {**half, **real}, None)
    bench.sheets[name] = {
        "half way": {"truth": right, **half},
        "fully": {"truth": halves[0][1], **shown, "other_scan": halves[1][1]},
    }
    return found


def _rusts(bench: _Bench) -> dict[str, dict[str, float]]:
    """How far what is rust in the left half of each scan is from that in the right half of each."""
    halves = {}
    for name in RUSTED:
        if name in RUST:
            halves[name] = _halves(bench.data, name, bench.size)
        else:
            scan = bench.scan(name)
            halves[name] = tuple(Picture(scan.weathered(each)) for each in (scan.left, scan.right))
    return {
        first: {
            second: bench.comparison.distance(left, right).distance
            for second, (_, right) in halves.items()
        }
        for first, (left, _) in halves.items()
    }


def _film(bench: _Bench) -> dict[str, Target]:
    """The lower half of copper's film at its ages, but for the first picture, which ours begins
    with.
    """
    bench.strip = film_of(bench.data, bench.aging, bench.names)
    return {
        f"{COPPER}_{age}": bench.target(
            row["truth"], {name: each for name, each in row.items() if name != "truth"}, None
        )
        for age, row in list(bench.strip.items())[1:]
    }


def _at_end(aged: Mapping[str, Aged]) -> Shown:
    return {name: Picture(each.end, time=1.0, seconds=each.seconds) for name, each in aged.items()}


def _at_mean(aged: Mapping[str, Aged], truth: np.ndarray) -> Shown:
    """When each has the mean color of the truth: how far it has come is not what is judged."""
    shown = {}
    for name, each in aged.items():
        k = nearest_in_mean(each.pictures, truth)
        when = k / (len(each.pictures) - 1)
        shown[name] = Picture(each.pictures[k], time=when, seconds=each.seconds)
    return shown


def _whole(half: Half) -> Picture:
    return Picture(half.picture)


def _halves(data: Path, name: str, size: int) -> tuple[Picture, Picture]:
    """Both halves of a scan that is weathered all over."""
    color = encoded(read_part(scan_folder(data, name), size).base_color)
    middle = color.shape[1] // 2
    return Picture(color[:, :middle]), Picture(color[:, middle:])


def _other(data: Path, name: str, size: int) -> tuple[Picture, Picture]:
    """Half of another scan, and what is weathered in it; of one without two states, all of it."""
    try:
        scan = HalvedScan.read(data, name, size)
    except InputError:
        whole = _halves(data, name, size)[0]
        return whole, whole
    return _whole(scan.left), Picture(scan.weathered(scan.left))
