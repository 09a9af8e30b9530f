"""Seconds against decibels, for every quality, knob and rival: `evaluate pareto`."""

from __future__ import annotations

import os
import platform
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from model_runtime.age import AgeRequest
from model_runtime.contract import AUTO, BALANCED, EXACT, LSTM_LATENTS
from model_runtime.modelling.aged import EFFORTS

from ..bench.aging import age_silently
from ..bench.kept import identity, kept_json
from ..bench.results import chosen, write_report
from ..synthesis.sources import Effort as Learning
from .chart import draw_chart
from .exact import Exact, exact_texels
from .figures import Probes, distinct_texels, each_texel, exact_point, figures, savings
from .lobes import lobe_rows
from .probes import large_run, uniform_run, warm_worker
from .report import tables
from .results import ParetoReport, Point, point_of, with_fronts
from .runs import Run, bundled, measure
from .settings import LATENTS, SETTINGS, Setting
from .truth import RIVALS, Truth, TruthRun

__all__ = ("evaluate_pareto",)

_QUARTER = 4
_TIMES = 16
_KINDS_OF_MODELING = ("", "palette", "rung", "samples", "fit")
"""Knobs that change what is modeled, and so how near to the truth it is."""


def evaluate_pareto(
    data: Path,
    output: Path,
    *,
    pixels: int = 64,
    size: int | None = None,
    frames: int = 36,
    texels: int = 4096,
    latents_texels: int = 512,
    large_frames: int = 4,
    materials: Sequence[str] | None = None,
    settings: Sequence[Setting] = SETTINGS,
    effort: Learning | None = None,
    paper_texels: int = 4,
    ntm: str = "fading",
) -> ParetoReport:
    """Run every one of `settings` on every material of `data`/pbr (or on `materials` alone); write
    `pareto.json`, `.md` and `.png` to `output`.

    pixels: width of the cases with a known truth
    size: width of the maps that are aged, by default 16 times that; a quarter and four times as
    wide ones, with `large_frames` frames, show how time and memory grow
    texels: of each material that are held against exact; `latents_texels` where latents are decoded
    effort: what is spent on learning the cases with a known truth; `paper_texels`: on how many
    the paper's pipeline is timed

    Every run is kept in `output`/kept once it has been made: an interrupted call goes on there, and
    a finished one is only written again.
    """
    size, folder = size or _TIMES * pixels, output / "kept"
    folder.mkdir(parents=True, exist_ok=True)
    aged = _materials(data, materials)
    bench = _Bench(aged, ntm, size, frames, texels, latents_texels, folder, bundled(ntm))
    truth = Truth(data, folder, pixels, learning=effort or Learning(), paper_texels=paper_texels)
    # The first run imports and allocates what a warm worker already has.
    age_silently(AgeRequest(aged[0], ntm, folder / "maps", frames=2, size=32))
    shutil.rmtree(folder / "maps")

    runs = bench.runs(settings)
    points = with_fronts(_points(bench, truth, settings, runs))
    by_name = {point.name: point for point in points}
    probes = bench.probes(truth, large_frames)
    whole, latents = (
        [bench.exact(material, rung) for material in aged] for rung in (AUTO, LSTM_LATENTS)
    )
    report = ParetoReport(
        points,
        figures(
            by_name,
            runs,
            probes,
            latents_seconds=each_texel(latents),
            distinct=distinct_texels(whole),
            size=size,
            frames=frames,
        ),
        savings(by_name, probes),
        bench.once("lobes", partial(lobe_rows, data, pixels=pixels), pixels),
        _machine(max(run.load for each in runs.values() for run in each.values())),
        {
            "size": size,
            "quarter": _QUARTER,
            "frames": frames,
            "texels": texels,
            "latents_texels": latents_texels,
            "pixels": pixels,
            "ntm": ntm,
            "materials": [material.name for material in aged],
        },
    )
    draw_chart(report, output / "pareto.png")
    write_report(output, "pareto", [tables(report)], report)
    return report


@dataclass(frozen=True)
class _Bench:
    """The materials, how they are aged, and where what was measured stays; `model` identifies the
    bundled files.
    """

    materials: Sequence[Path]
    ntm: str
    size: int
    frames: int
    texels: int
    latents_texels: int
    folder: Path
    model: str

    def runs(self, settings: Sequence[Setting]) -> dict[str, dict[str, Run]]:
        """By setting and material, held against exact."""
        return {
            setting.name: {
                material.name: self._run(setting, material)
                for material in tqdm(self.materials, desc=setting.name, unit=" material")
            }
            for setting in settings
        }

    def _run(self, setting: Setting, material: Path) -> Run:
        latents = setting.panel == "latents"
        return measure(
            setting,
            material,
            self.ntm,
            self.exact(material, LSTM_LATENTS if latents else AUTO),
            frames=self.frames,
            size=self._width(latents),
            folder=self.folder,
            model=self.model,
        )

    def exact(self, material: Path, rung: str) -> Exact:
        """Some texels of a material, exactly; of latents fewer, on smaller maps."""
        latents = rung == LSTM_LATENTS
        return exact_texels(
            material,
            self.ntm,
            rung,
            size=self._width(latents),
            frames=self.frames,
            texels=self.latents_texels if latents else self.texels,
            folder=self.folder,
        )

    def _width(self, latents: bool) -> int:
        return self.size // _QUARTER if latents else self.size

    def probes(self, truth: Truth, frames: int) -> Probes:
        """What is measured once, on the first material."""
        first, ntm, folder, size = self.materials[0], self.ntm, self.folder, self.size
        sizes = (size // _QUARTER, size, size * _QUARTER)

        def in_child(width: int, count: int, binding: str = "frames") -> dict[str, float]:
            run = partial(large_run, first, ntm, size=width, frames=count, beside=folder)
            name = f"large_{width}_{count}_{binding}"
            return self.once(name, partial(run, binding=binding), first.name)

        uniform = partial(uniform_run, ntm, frames=self.frames, size=size, beside=folder)
        worker = partial(warm_worker, first, ntm, size=size, beside=folder)
        return Probes(
            large={width: in_child(width, frames) for width in tqdm(sizes, desc="sizes")},
            frames=frames,
            usual=in_child(size, self.frames),
            live=in_child(max(sizes), self.frames, "live"),
            worker=self.once("worker", worker, size),
            uniform=self.once("uniform", uniform, self.frames, size),
            paper=self.once("paper", truth.paper_seconds),
        )

    def once(self, name: str, make: Callable[[], Any], *made_from: object) -> Any:
        """What `make` gives, kept as `name` of `made_from`."""
        of = identity(self.model, f"{name} {made_from}")
        return kept_json(self.folder / f"{name}.json", of, make)


def _points(
    bench: _Bench,
    truth: Truth,
    settings: Sequence[Setting],
    runs: Mapping[str, Mapping[str, Run]],
) -> list[Point]:
    """The settings, then exact, then the rivals."""
    known = {
        setting.name: truth.setting(setting.name, setting.effort, setting.rung)
        for setting in tqdm(settings, desc="known histories", unit=" setting")
        if setting.knob in _KINDS_OF_MODELING
    }
    points = [point_of(each, runs[each.name], known.get(each.name)) for each in settings]
    by_name = {point.name: point for point in points}
    for name, base, rung in (
        ("exact", BALANCED, AUTO),
        ("latents exact", LATENTS, LSTM_LATENTS),
    ):
        found = [bench.exact(material, rung) for material in bench.materials]
        near = truth.setting(name, EFFORTS[EXACT], rung)
        points.append(exact_point(name, by_name[base], found, near))
    balanced = by_name[BALANCED]
    times = bench.size**2 / truth.pixels**2
    return [*points, *(_rival(name, truth.rival(name), balanced, times) for name in RIVALS)]


def _materials(data: Path, names: Sequence[str] | None) -> list[Path]:
    """The folders of the materials, all of `data`/pbr by default."""
    folders = {path.name: path for path in sorted((data / "pbr").iterdir()) if path.is_dir()}
    return [folders[name] for name in chosen("material", names, folders)]


def _rival(name: str, truth: TruthRun, balanced: Point, times: float) -> Point:
    """A method that is compared with the truth alone: its seconds are those of modeling, `times`
    as many texels as the truth has, and of reading and writing them as `balanced` does.
    """
    modeling = truth.seconds * times
    return replace(
        balanced,
        name=name,
        knob="rival",
        panel="rival",
        core=modeling + balanced.core_of("read") + balanced.core_of("write"),
        wall=None,
        stages={"model": modeling},
        psnr={},
        worst_frame=None,
        megabytes=None,
        entries=None,
        frames=None,
        truth=truth,
        extrapolated=True,
    )


def _machine(load: float) -> dict[str, Any]:
    """What it was measured on; `load` is the highest load average of any run, 1 on a quiet one."""
    return {
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "torch": torch.__version__,
        "highest_load": round(load, 2),
    }
