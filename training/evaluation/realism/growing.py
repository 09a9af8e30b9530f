"""What grows beside color: relief across the edges of chips, and spots over time."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from model_runtime.age import AgeRequest
from model_runtime.contract import FRAMES, TORRANCE_SPARROW, frame_file
from model_runtime.images import read_image, write_exr

from ...data.sequences import Sequence
from ..bench.aging import age_silently
from ..bench.kept import identity
from .aging import Aging, Source
from .methods import Aged, Array
from .relief import BINS, Profile, compare_profiles, profile, weathered
from .spots import LAPSES, apart, halves_of, read_lapse, spot_curves, spread
from .targets import HalvedScan

__all__ = ("relief_of", "spots_of")


def relief_of(scan: HalvedScan, aging: Aging) -> dict[str, Any]:
    """Height by distance from the border of what is weathered: of the right half, of the left one,
    and of what ours makes of the left one's clean material when as much of it is weathered.

    `correlation` with the right half, and `lip`, whether there is one before the drop; null where
    ours changes no height.
    """
    source = Source(scan)
    learned = aging.of_scan(source)
    aged = aging.aged("ours", scan.name, lambda: scan.clean, source, learned.path)
    clean, gone = (
        scan.left.picture[some].mean(0) for some in (scan.left.depth < 0, scan.left.depth > 0)
    )
    right, left = (
        profile(half.height, weathered(half.picture, clean, gone), wraps=False)
        for half in (scan.right, scan.left)
    )
    found: dict[str, Any] = {
        "distance": ((BINS[1:] + BINS[:-1]) / 2).tolist(),
        "truth": right,
        "own_half": {"profile": left, "correlation": compare_profiles(right, left)[0]},
        "correlation": None,
        "lip": None,
    }
    mine = _profile_of(aged, clean, gone, float((scan.right.depth > 0).mean()))
    if mine is not None:
        alike, lip = compare_profiles(right, mine)
        found |= {"ours": mine, "correlation": alike, "lip": lip}
    return found


def _profile_of(aged: Aged, clean: Array, gone: Array, share: float) -> Profile | None:
    if aged.heights is None:
        return None
    masks = [weathered(picture, clean, gone) for picture in aged.pictures]
    k = int(np.abs([mask.mean() - share for mask in masks]).argmin())
    return profile(aged.heights[k], masks[k], wraps=False)


def spots_of(data: Path, aging: Aging) -> dict[str, Any]:
    """By real sequence: curves of spots over time in the right half, in the left one and in what
    ours makes of the first frame of the right one after the left one; how far ours is `apart` from
    the truth by statistic, and how far the sequence's own halves are (`spread`).
    """
    found: dict[str, Any] = {}
    for name, process in LAPSES.items():
        lapse = read_lapse(data, name)
        halves = halves_of(lapse.kd)
        first, last = (lapse.kd[k].mean((0, 1)) for k in (0, -1))
        curves = {side: spot_curves(kd, first, last) for side, kd in halves.items()}
        ours = spot_curves(_continued(lapse, process, aging), first, last)
        found[name] = {
            "curves": {
                side: each.tolist()
                for side, each in (*curves.items(), ("ours", ours))
                if side in ("left", "right", "ours")
            },
            "apart": apart(ours, curves["right"]),
            "spread": spread(curves),
        }
    return found


def _continued(lapse: Sequence, process: str, aging: Aging) -> Array:
    """Kd [T, H, W, 3] of the right half's first frame, aged after the left half."""
    middle = lapse.alpha.shape[2] // 2
    left = replace(
        lapse,
        kd=lapse.kd[:, :, :middle],
        ks=lapse.ks[:, :, :middle],
        alpha=lapse.alpha[:, :, :middle],
    )
    made_from = identity(torch.from_numpy(np.ascontiguousarray(left.kd)), process)
    learned = aging.learned(left, lapse.name, process, made_from)
    with tempfile.TemporaryDirectory() as folder:
        start, output = Path(folder) / "start", Path(folder) / "aged"
        start.mkdir()
        for name in ("kd", "ks", "alpha"):
            write_exr(start / f"{name}.exr", getattr(lapse, name)[0, :, middle:])
        frames = len(lapse.times)
        age_silently(
            AgeRequest(
                start,
                str(learned.path),
                output,
                frames=frames,
                format=TORRANCE_SPARROW,
                binding=FRAMES,
            )
        )
        files = [output / frame_file("kd", k) for k in range(frames)]
        return np.stack([read_image(file, color=True) for file in files])
