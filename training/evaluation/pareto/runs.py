"""Runs of `age`, timed and held against exact; each is kept, so that it is made once."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from model_runtime.age import AgeRequest
from model_runtime.contract import BALANCED, LIVE, REPORT
from model_runtime.images import Compression, read_image
from model_runtime.model_files.weights import ENCODER, ESTIMATOR, find_model
from model_runtime.output.stored import StagedResult

from ..bench.aging import age_silently, megabytes
from ..bench.kept import code, identity, kept_json
from .exact import Exact
from .settings import Setting

__all__ = ("Run", "bundled", "measure")


@dataclass(frozen=True)
class Run:
    """One run of `age` on one material.

    wall, core: seconds from the request to the files being there, by the clock and of one core
    stages: wall seconds of each, as `aged.json` has them
    megabytes: of what was written
    entries: of the palette
    rung: the model of change that was used
    frames: that were written, of the map with the most; none where the material is live
    psnr: dB against exact in each frame that is compared
    writing: (wall, core) seconds to write the same maps from memory; None where not measured
    load: how many processes wanted a core meanwhile (the load average of the last minute)
    """

    wall: float
    core: float
    stages: Mapping[str, float]
    megabytes: float
    entries: int
    rung: str
    frames: int
    psnr: Sequence[float]
    writing: Sequence[float] | None
    load: float


def bundled(ntm: str) -> str:
    """What identifies the bundled model `ntm`, the encoder, the estimator and the program."""
    files = find_model(ntm), ENCODER, ESTIMATOR
    return identity(code(), *(path.read_bytes().hex() for path in files))


def measure(
    setting: Setting,
    material: Path,
    ntm: str,
    exact: Exact,
    *,
    frames: int,
    size: int,
    folder: Path,
    model: str,
) -> Run:
    """Age `material` as `setting` says and hold the written maps against `exact`.

    `size` and `frames` are those of the setting's panel, `model` what `bundled` says of `ntm`. The
    numbers stay in `folder`, the maps do not.
    """
    request = setting.request(frames, size)

    def make() -> dict[str, Any]:
        maps = folder / "maps"
        wall, core = time.perf_counter(), time.process_time()
        report = age_silently(AgeRequest(material, ntm, maps, **request), setting.effort)
        wall, core = time.perf_counter() - wall, time.process_time() - core
        load = os.getloadavg()[0]
        writing = None
        if setting.name == BALANCED:
            writing = _writing_alone(maps, folder, setting.effort.compression)
        run = Run(
            wall=round(wall, 3),
            core=round(core, 3),
            stages=report["seconds"],
            megabytes=round(megabytes(maps), 3),
            entries=report["palette"],
            rung=report["temporal_model"],
            frames=_frames(report),
            psnr=[round(value, 3) for value in exact.psnr(maps)],
            writing=writing,
            load=round(load, 2),
        )
        shutil.rmtree(maps)
        return asdict(run)

    name = f"{setting.name}_{material.name}".replace(" ", "_").replace("/", "by")
    made_from = identity(exact.states, model, f"{request} {setting.effort}")
    return Run(**kept_json(folder / f"run_{name}.json", made_from, make))


def _frames(report: Mapping[str, Any]) -> int:
    if report["binding"] == LIVE:
        return 0
    return max(len(_written(files)) for files in report["files"].values())


def _written(files: list[Any]) -> set[str]:
    """The files of one map of `aged.json`."""
    return {
        name
        for made_of in files
        for name in ([made_of] if isinstance(made_of, str) else [part[0] for part in made_of])
    }


def _writing_alone(folder: Path, beside: Path, compression: Compression) -> tuple[float, float]:
    """Seconds, by the clock and of one core, to write the maps in `folder` again, from memory, the
    same way; worked out from every third frame.
    """
    report = json.loads((folder / REPORT).read_text(encoding="utf-8"))
    frames = list(zip(*report["files"].values(), strict=True))
    wall = core = 0.0
    with StagedResult(beside / "again", compression=compression) as staged:
        for frame in frames[::3]:
            maps = [
                read_image(folder / name, color=map_name == "base_color").astype(np.float16)
                for map_name, name in zip(report["files"], frame, strict=True)
            ]
            start = time.perf_counter(), time.process_time()
            for name, pixels in zip(frame, maps, strict=True):
                staged.write(name, pixels)
            staged.finish()
            wall += time.perf_counter() - start[0]
            core += time.process_time() - start[1]
    share = len(frames) / len(frames[::3])
    return wall * share, core * share
