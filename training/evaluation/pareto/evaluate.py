"""Seconds against decibels, for every quality, knob and rival: `evaluate pareto`."""

from __future__ import annotations

import json
import os
import platform
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from model_runtime.age import AgeRequest, age
from model_runtime.contract import AUTO, BALANCED, EXACT, LSTM_LATENTS
from model_runtime.errors import InputError
from model_runtime.modelling.aged import EFFORTS

from ..bench.kept import identity
from ..bench.silent import Silent
from ..synthesis.training import Effort as Teaching
from .chart import draw_chart
from .exact import Exact, exact_texels
from .figures import Probes, exact_point, figures, savings
from .probes import large_run, uniform_run, warm_worker
from .report import tables
from .results import ParetoReport, Point, point_of, with_fronts
from .runs import Run, bundled, kept_json, measure
from .settings import LATENTS, SETTINGS, Setting
from .truth import RIVALS, Truth, TruthRun

__all__ = ("evaluate_pareto",)

_QUARTER = 4
_TIMES = 16
_KINDS_OF_MODELLING = ("", "palette", "rung", "samples", "fit", "precision")
"""Knobs that change what is modelled, and so how near to the truth it is."""


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
    teaching: Teaching | None = None,
    paper_texels: int = 4,
    ntm: str = "rust",
) -> ParetoReport:
    """Run every one of `settings` on every material of `data`/pbr (or on `materials` alone); write
    `pareto.json`, `.md` and `.png` to `output`.

    pixels: width of the cases with a known truth
    size: width of the maps that are aged, by default 16 times that; a quarter and four times as
    wide ones, with `large_frames` frames, show how time and memory grow
    texels: of each material that are held against exact; `latents_texels` where latents are decoded
    teaching: what is spent on learning the cases with a known truth; `paper_texels`: on how many
    the paper's pipeline is timed

    Every run is kept in `output`/kept once it has been made: an interrupted call goes on there, and
    a finished one is only written again.
    """
    size = size or _TIMES * pixels
    kept = output / "kept"
    kept.mkdir(parents=True, exist_ok=True)
    folders = _materials(data, materials)
    bench = _Bench(folders, ntm, size, frames, texels, latents_texels, kept)
    truth = Truth(data, kept, pixels, teaching=teaching or Teaching(), paper_texels=paper_texels)
    # The first run imports and allocates what a warm worker already has.
    age(AgeRequest(folders[0], ntm, kept / "maps", frames=2, size=32), Silent())
    shutil.rmtree(kept / "maps")

    runs: dict[str, dict[str, Run]] = {}
    for setting in settings:
        runs[setting.name] = {}
        for folder in tqdm(folders, desc=setting.name, unit=" material"):
            runs[setting.name][folder.name] = bench.run(setting, folder)
    known: dict[str, TruthRun] = {}
    for setting in tqdm(settings, desc="known histories", unit=" setting"):
        if setting.knob in _KINDS_OF_MODELLING:
            known[setting.name] = truth.setting(setting.name, setting.effort, setting.rung)
    points = [point_of(each, runs[each.name], known.get(each.name)) for each in settings]
    by_name = {point.name: point for point in points}
    for name, base, rung, panel_size in (
        ("exact", BALANCED, AUTO, size),
        ("latents exact", LATENTS, LSTM_LATENTS, size // _QUARTER),
    ):
        found = [bench.exact(folder, rung) for folder in folders]
        near = truth.setting(name, EFFORTS[EXACT], rung)
        points.append(exact_point(name, by_name[base], found, panel_size**2, near))
    points += [_rival(name, truth.rival(name), by_name[BALANCED], size, pixels) for name in RIVALS]
    points = with_fronts(points)
    by_name = {point.name: point for point in points}
    sizes = (size // _QUARTER, size, size * _QUARTER)
    probes = _probes(bench, truth, sizes, large_frames)
    latents = [bench.exact(folder, LSTM_LATENTS) for folder in folders]
    each = sum(one.seconds for one in latents) / sum(len(one.rows) for one in latents)
    report = ParetoReport(
        points,
        figures(by_name, runs, probes, latents_seconds=each, size=size, frames=frames),
        savings(by_name, probes),
        _machine(max(run.load for each in runs.values() for run in each.values())),
        {
            "size": size,
            "quarter": _QUARTER,
            "frames": frames,
            "texels": texels,
            "latents_texels": latents_texels,
            "pixels": pixels,
            "ntm": ntm,
            "materials": [folder.name for folder in folders],
        },
    )
    draw_chart(report, output / "pareto.png")
    (output / "pareto.md").write_text(tables(report) + "\n", encoding="utf-8")
    text = json.dumps(report.json(), indent=1)
    (output / "pareto.json").write_text(text, encoding="utf-8")
    return report


class _Bench:
    """The materials, how they are aged, and where what was measured stays."""

    def __init__(
        self,
        folders: Sequence[Path],
        ntm: str,
        size: int,
        frames: int,
        texels: int,
        latents_texels: int,
        kept: Path,
    ) -> None:
        self.folders, self.ntm, self.size, self.frames = folders, ntm, size, frames
        self.texels, self.latents_texels, self.kept = texels, latents_texels, kept
        self.model = bundled(ntm)

    def run(self, setting: Setting, folder: Path) -> Run:
        """One material as `setting` says, held against exact."""
        latents = setting.panel == "latents"
        return measure(
            setting,
            folder,
            self.ntm,
            self.exact(folder, LSTM_LATENTS if latents else AUTO),
            frames=self.frames,
            size=self.size // _QUARTER if latents else self.size,
            kept=self.kept,
            model=self.model,
        )

    def exact(self, folder: Path, rung: str) -> Exact:
        """Some texels of a material, exactly; of latents fewer, on smaller maps."""
        latents = rung == LSTM_LATENTS
        return exact_texels(
            folder,
            self.ntm,
            rung,
            size=self.size // _QUARTER if latents else self.size,
            frames=self.frames,
            texels=self.latents_texels if latents else self.texels,
            kept=self.kept,
        )

    def once(self, name: str, make: Any, *made_from: object) -> Any:
        """What `make` gives, kept."""
        of = identity(self.model, f"{name} {made_from}")
        return kept_json(self.kept / f"{name}.json", of, make)


def _probes(bench: _Bench, truth: Truth, sizes: Sequence[int], frames: int) -> Probes:
    """What is measured once, on the first material."""
    first, ntm, kept = bench.folders[0], bench.ntm, bench.kept

    def in_child(size: int, count: int, binding: str = "frames") -> dict[str, float]:
        return bench.once(
            f"large_{size}_{count}_{binding}",
            lambda: large_run(first, ntm, size=size, frames=count, beside=kept, binding=binding),
            first.name,
        )

    return Probes(
        large={size: in_child(size, frames) for size in tqdm(sizes, desc="sizes")},
        frames=frames,
        usual=in_child(bench.size, bench.frames),
        live=in_child(max(sizes), bench.frames, "live"),
        worker=bench.once(
            "worker", lambda: warm_worker(first, ntm, size=bench.size, beside=kept), bench.size
        ),
        uniform=bench.once(
            "uniform",
            lambda: uniform_run(ntm, frames=bench.frames, size=bench.size, beside=kept),
            bench.frames,
            bench.size,
        ),
        paper=bench.once("paper", truth.paper_seconds),
    )


def _materials(data: Path, names: Sequence[str] | None) -> list[Path]:
    """The folders of the materials, all of `data`/pbr by default."""
    folders = sorted(path for path in (data / "pbr").iterdir() if path.is_dir())
    known = {folder.name: folder for folder in folders}
    unknown = [name for name in names or () if name not in known]
    if unknown:
        raise InputError(
            f"There is no material '{unknown[0]}'.", f"Choose among {', '.join(known)}."
        )
    return folders if names is None else [known[name] for name in names]


def _rival(name: str, truth: TruthRun, balanced: Point, size: int, pixels: int) -> Point:
    """A method that is compared with the truth alone: its seconds are those of modelling, for as
    many texels as the maps have, and of reading and writing them as `balanced` does.
    """
    texels = size**2 / pixels**2
    return Point(
        name=name,
        knob="rival",
        panel="rival",
        core=truth.seconds * texels + balanced.core_of("read") + balanced.core_of("write"),
        wall=None,
        stages={"model": truth.seconds * texels},
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
