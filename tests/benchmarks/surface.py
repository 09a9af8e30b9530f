"""How aging grows over surfaces, in numbers.

    python -m tests.benchmarks.surface [--size 512] [FOLDER ...]

Prints for three meshes of our own, and for each FOLDER of maps (position.exr, normal.exr, ...), the
seam ratio of eight processes; the rank correlation of onset with each exposure alone (pattern 0.3);
how much of what has turned by half time hangs together with where it began; by how much the
coverage curve of another seed differs; how much more is stained below than beside iron bolts on a
wall; and what 1024 x 1024 and 4096 x 4096 texels take.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from model_runtime.surface.atlas import Atlas
from model_runtime.surface.exposure import Exposure, features
from model_runtime.surface.graph import arrival, join
from model_runtime.surface.maps import read_surface
from model_runtime.surface.points import sample
from model_runtime.surface.timing import SurfaceTiming, surface_timing
from tests.meshes import (
    atlas_of,
    ball,
    below_and_beside,
    bolted_wall,
    box,
    pipe,
    rank_correlation,
)

PROCESSES = ("rust", "patina", "char", "drying", "fading", "soiling", "yellowing", "moss")
BLOCK = box((0, 0, 0.5), (1, 1, 1))
MESHES = {
    "block": BLOCK,
    "pipe": pipe((0, 0, 1), 0.2, 2.0),
    "ball on a block": [*BLOCK, *ball((0, 0, 1.39), 0.4)],
}


def grown(atlas: Atlas, process: str, size: int, seed: int = 0, **weights: float) -> SurfaceTiming:
    exposure = Exposure.of(process).changed(weights)
    return surface_timing(atlas, process, (size, size), seed=seed, exposure=exposure)


def correlations(atlas: Atlas, size: int) -> Iterator[str]:
    """By points of the surface: rank correlation of how early they start with each feature."""
    points = sample(atlas)
    known = features(atlas, points, join(points))
    none = dict.fromkeys(Exposure().json(), 0.0) | {"pattern": 0.3}
    flat = replace(atlas, features={})
    for name in ("edges", "crevices", "sky", "ground"):
        if not known[name].any():
            continue
        onset = grown(atlas, "rust", size, **(none | {name: 1.0})).onset
        rows, columns = ((np.arange(n) * 2 + 1) * size // (2 * n) for n in flat.size)
        early = -points.mean_of(onset[np.ix_(rows, columns)])
        yield f"{name} {rank_correlation(early, known[name]):.2f}"


def connected(atlas: Atlas, size: int) -> float:
    """The share of what has turned by half time that hangs together with where it began: with the
    first 6 %. Spots that appear later, as pits go on to do, count as apart.
    """
    points = sample(atlas)
    graph = join(points)
    rows, columns = ((np.arange(n) * 2 + 1) * size // (2 * n) for n in atlas.size)
    onset = points.mean_of(grown(atlas, "rust", size).onset[np.ix_(rows, columns)])
    turned = onset <= 0.5
    births = np.where(onset <= np.quantile(onset, 0.06), 0, np.inf).astype(np.float32)
    open_ = turned & turned[graph.neighbor] & np.isfinite(graph.distance)
    reached = np.isfinite(arrival(graph, births, np.where(open_, 0, np.inf).astype(np.float32)))
    return float(points.area[turned & reached].sum() / points.area[turned].sum())


def stained(size: int) -> tuple[float, float]:
    """The mean age at the end below the bolts of a wall, and beside them."""
    wall = bolted_wall(size)
    exposure = Exposure(runs=1.0, pattern=0.5)
    found = surface_timing(wall, "rust", (size, size), seed=0, exposure=exposure, amount=0.08)
    age = found.rate * (1 - found.onset)
    below, beside = (float(age[part].mean()) for part in below_and_beside(wall))
    return below, beside


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--size", type=int, default=512)
    arguments = parser.parse_args()
    size: int = arguments.size
    atlases = {name: atlas_of(patches, size) for name, patches in MESHES.items()}
    atlases |= {folder.name: read_surface(folder) for folder in arguments.folders}
    for name, atlas in atlases.items():
        ratios = {process: grown(atlas, process, size).seam_ratio for process in PROCESSES}
        print(f"{name}: seam ratio", *(f"{process} {value}" for process, value in ratios.items()))
        print(f"{name}: rank correlation", *correlations(atlas, size))
        print(f"{name}: connected at half time {connected(atlas, size):.3f}")
        curves = [
            list(grown(atlas, "rust", size, seed).account["started"].values()) for seed in (1, 2)
        ]
        print(f"{name}: coverage of two seeds differs by {np.ptp(curves, axis=0).max():.4f}")
    below, beside = stained(size)
    print(f"stain below a bolt {below:.4f}, beside {beside:.4f} of age 1")
    atlas = atlas_of(MESHES["ball on a block"], 1024)
    for side in (1024, 4096):
        held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        wall, busy = time.perf_counter(), time.process_time()
        grown(replace(atlas), "rust", side)
        wall, busy = time.perf_counter() - wall, time.process_time() - busy
        more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - held) >> 10
        print(f"{side} x {side}: {wall:.1f} s, {busy:.1f} s of a core, {more} MB more at the peak")


if __name__ == "__main__":
    main()
